"""What several files say of the drift of the pressure wire.

Where the wire lies beside the aortic catheter, both must read the same mean: such a file, taken
before or after the others, gives the offset of the wire then. The last of them less the first (or
less nothing, since wires are equalised at the start) is the drift. Without one, a condition that
was measured twice shows it, together with any change of the patient:

    drift = mean P_distal,2 − mean P_distal,1 · mean P_aorta,2/mean P_aorta,1.
"""

import dataclasses
from collections.abc import Sequence

from study.case.catheter.beat_means import ImportedCondition

LEAST_DRIFT = 0.5
"""Drift below which nothing follows [mmHg]: sensors are equalised no better."""


@dataclasses.dataclass(frozen=True)
class WireDrift:
    """Drift of the wire.

    Attributes:
        size: of the distal pressure at the end of the examination [mmHg].
        origin: which files say so.
        certain: whether they show the wire alone, and no change of the patient.
    """

    size: float
    origin: str
    certain: bool

    def sentence(self, ratio: float, mean_P_aorta: float) -> str:
        """The drift in words, and what it does to a ratio."""
        other = ratio - self.size / mean_P_aorta
        cause = "" if self.certain else ", or the patient has changed"
        return (
            f"The wire reads {self.size:+.1f} mmHg at the end ({self.origin}){cause}. Nothing was "
            f"corrected; without it the last ratio would be {other:.3f} instead of {ratio:.3f}."
        )


def wire_drift(
    conditions: Sequence[ImportedCondition], checks: Sequence[ImportedCondition]
) -> WireDrift | None:
    """Drift of the wire, where the files say anything of it.

    Args:
        conditions: in the order of measurement.
        checks: files with the wire beside the aortic catheter, likewise.
    """
    if checks:
        offsets = [c.means.mean_P_distal - c.means.mean_P_aorta for c in checks]
        start = offsets[0] if len(offsets) > 1 else 0.0
        files = dict.fromkeys((checks[0].trace.path.name, checks[-1].trace.path.name))
        names = " and ".join(files)
        return WireDrift(offsets[-1] - start, f"wire in the aorta: {names}", True)
    for k, first in enumerate(conditions):
        again = [c for c in conditions[k + 1 :] if c.drug == first.drug]
        if again:
            one, two = first.means, again[-1].means
            size = two.mean_P_distal - one.mean_P_distal * two.mean_P_aorta / one.mean_P_aorta
            return WireDrift(size, f"{first.name} measured twice", False)
    return None
