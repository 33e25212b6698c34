"""The curve of a ramp, and what documents hold of it."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from calibration import RampFit, RampRecord, fit_ramp, measured_slope
from lumped import MMHG
from study.run.study_choice import RampChoice
from study.run.study_parts import RampPart, RampPower, Secant
from study.store.json_form import ABSENT, Absent


class RampLosses(NamedTuple):
    """What takes the power of a ramp's flow, see `jaxfsi.fields.viscous_loss`.

    Attributes:
        t: times of the frames [s].
        viscous: E, resolved viscosity [erg/s].
        defect: η, its mesh error [erg/s].
        unresolved: S, the scales below the mesh [erg/s].
    """

    t: Float[np.ndarray, " frames"]
    viscous: Float[np.ndarray, " frames"]
    defect: Float[np.ndarray, " frames"]
    unresolved: Float[np.ndarray, " frames"]


@dataclasses.dataclass(frozen=True)
class FittedRamp:
    """A ramp and its curve.

    Attributes:
        record: pressures and flow.
        fit: the curve.
        choice: how the ramp was made.
        losses: at its frames; None where there are none.
    """

    record: RampRecord
    fit: RampFit
    choice: RampChoice
    losses: RampLosses | None = None

    @property
    def part(self) -> RampPart:
        """The ramp as documents hold it."""
        record, fit = self.record, self.fit
        slope, slope_sd = fit.tangent()
        secants = {}
        for drop in (4.0, 8.0, 20.0, 40.0):
            secant, sd = fit.secant(drop * MMHG)
            secants[f"{drop:g}"] = Secant(float(secant), float(sd))
        some = slice(None, None, max(1, len(record.t) // 200))
        return RampPart(
            P_image_mmHg=self.choice.P_image / MMHG,
            rate_mmHg_per_s=self.choice.rate / MMHG,
            largest_drop_mmHg=float(fit.largest_drop) / MMHG,
            a=float(fit.law.R0),
            a_sd=float(np.sqrt(fit.covariance[0, 0])),
            b=float(fit.law.K),
            b_sd=float(np.sqrt(fit.covariance[1, 1])),
            inertance=float(fit.L),
            rms_mmHg=float(fit.rms) / MMHG,
            n_effective=float(fit.n_effective),
            tangent_40_mmHg=float(slope),
            tangent_40_mmHg_sd=float(slope_sd),
            measured_slope_40_mmHg=measured_slope(record),
            secants_by_drop_mmHg=secants,
            Q_cm3_per_s=[float(f"{v:.7g}") for v in np.asarray(record.Q)[some]],
            drop_mmHg=[float(f"{v:.7g}") for v in np.asarray(record.drop)[some] / MMHG],
            power=ABSENT if self.losses is None else ramp_power(record, self.losses),
        )


def fitted(record: RampRecord, choice: RampChoice, losses: RampLosses | None = None) -> FittedRamp:
    """The curve of the ramp."""
    return FittedRamp(record, fit_ramp(record, P_ref=choice.P_image), choice, losses)


def ramp_power(record: RampRecord, losses: RampLosses) -> RampPower | Absent:
    """Shares of the power; absent where no frame has flow down the drop."""
    Q, drop = (np.interp(losses.t, record.t, v) for v in (record.Q, record.drop))
    flows = (Q > 0.0) & (drop > 0.0)
    if not np.any(flows):
        return ABSENT
    Q, drop = Q[flows], drop[flows]
    E, eta, S = (np.asarray(part)[flows] for part in losses[1:])
    power = drop * Q
    return RampPower(
        viscous=float(E[-1] / Q[-1] ** 2),
        viscous_defect=float(eta[-1] / Q[-1] ** 2),
        frame_drop_mmHg=_rounded(drop / MMHG),
        viscous_share=_rounded(E / power),
        defect_share=_rounded(eta / power),
        unresolved_share=_rounded(S / power),
    )


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{v:.4g}") for v in values]
