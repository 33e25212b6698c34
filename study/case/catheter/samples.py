"""Clean samples of one file."""

import dataclasses
import pathlib
from collections.abc import Mapping

import numpy as np

from study.case.catheter.table import refusal


@dataclasses.dataclass(frozen=True)
class CatheterTrace:
    """Samples of one file.

    Attributes:
        path: the file.
        t: times [s], ascending.
        waves: samples of `P_aorta`, `P_distal` [mmHg] and where recorded `Q_coronary` [mL/min].
        step: usual step [s].
        remarks: what was left out, in sentences.
        columns: names of the columns in the file, by what they hold.
    """

    path: pathlib.Path
    t: np.ndarray
    waves: dict[str, np.ndarray]
    step: float
    remarks: tuple[str, ...]
    columns: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def within(self, span: tuple[float, float]) -> "CatheterTrace":
        """The samples between two times [s].

        Raises:
            CaseError: there are too few.
        """
        kept = (self.t >= span[0]) & (self.t <= span[1])
        if kept.sum() < 2:
            problem = f"no samples from {span[0]:g} s to {span[1]:g} s"
            cure = f"choose a span within {self.t[0]:g} s to {self.t[-1]:g} s"
            raise refusal(self.path, problem, cure, key="--span")
        waves = {name: wave[kept] for name, wave in self.waves.items()}
        return dataclasses.replace(self, t=self.t[kept], waves=waves)
