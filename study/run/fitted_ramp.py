"""The curve of a ramp, and what documents hold of it."""

import dataclasses

import numpy as np

from calibration import RampFit, RampRecord, fit_ramp, measured_slope
from lumped import MMHG
from study.run.study_choice import RampChoice
from study.run.study_parts import RampPart, Secant


@dataclasses.dataclass(frozen=True)
class FittedRamp:
    """A ramp and its curve.

    Attributes:
        record: pressures and flow.
        fit: the curve.
        choice: how the ramp was made.
    """

    record: RampRecord
    fit: RampFit
    choice: RampChoice

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
        )


def fitted(record: RampRecord, choice: RampChoice) -> FittedRamp:
    """The curve of the ramp."""
    return FittedRamp(record, fit_ramp(record, P_ref=choice.P_image), choice)
