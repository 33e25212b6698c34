"""How well each number of a patient is known before FFR is predicted.

| number | spread | why |
|---|---|---|
| resting ratio | its sd, cut off at 1 | drift ± 2 mmHg: Cook et al. 2016, Circ. CI 9:e002988 |
| pressures | 3 mmHg | fluid-filled catheters, pull-back of the zero line |
| period | 2 % | beat-to-beat variation within a recording |
| losses R0, K | 30 % | 0.1 mm of a minor axis of 1.3 mm, to the third power, and the mesh |
| LV pressure on the bed | 30 % | 1.5 left, 0.5 right: Kim et al. 2010; 1 in the paper |
| venous pressure | 3 to 12 mmHg | right atrium 5 to 9, outflow ends at 10 to 14: Chilian & Marcus |
| | | 1984, AJP 247:H984; 0 in the paper |
| bed and slit under stress | | `calibration.stress_evidence` |

α is tuned to the resting ratio in each sample, so that what R0 and the venous pressure do is mostly
taken back.
"""

import equinox as eqx
import numpy as np

from calibration.spreads import AbstractSpread, LogNormal, Normal, Truncated, Uniform
from calibration.stress_evidence import StressEvidence
from calibration.stress_ratio import StressRatio
from calibration.uncertain_names import BED_FACTOR, REST_PREFIX, STRESS_LOSS
from lumped.nominal import IM_FACTOR_SD, LOSS_SD, P_VENOUS_RANGE, PERIOD_SD, PRESSURE_SD
from lumped.parameters import Parameter

HIGHEST_RATIO = 0.999
"""A resting ratio of 1 has no α."""


class MeasurementErrors(eqx.Module):
    """Standard deviations of what is measured of a patient.

    Attributes:
        rest_ratio: of the resting ratio [-].
        pressure: of each systolic and diastolic pressure [dyn/cm²].
        period: of the period, relative [-].
        loss: of log R0 and log K [-].
        im_factor: of the logarithm of the share of the ventricle's pressure in the muscle [-].
        P_venous: least and largest venous pressure [dyn/cm²].
    """

    rest_ratio: float
    pressure: float = PRESSURE_SD
    period: float = PERIOD_SD
    loss: float = LOSS_SD
    im_factor: float = IM_FACTOR_SD
    P_venous: tuple[float, float] = P_VENOUS_RANGE


def patient_inputs(
    patient: StressRatio, evidence: StressEvidence, errors: MeasurementErrors
) -> dict[str, AbstractSpread]:
    """Distribution of each number of a patient, for `uncertainty` of `patient.ffr`.

    Args:
        patient: the patient; what was measured is the middle of each distribution.
        evidence: what stress does.
        errors: of the measurements.
    """
    now, artery = patient.values, patient.surrogate
    inputs: dict[str, AbstractSpread | None] = {
        "rest_ratio": Truncated(now["rest_ratio"], errors.rest_ratio, 0.0, HIGHEST_RATIO),
        BED_FACTOR: evidence.bed_factor,
        STRESS_LOSS: evidence.stress_loss,
        "R0": _factor(artery.R0, errors.loss),
        "im_factor": _factor(artery.coronary.im_factor, errors.im_factor),
        "P_venous": Uniform(*errors.P_venous),
        "K": _factor(artery.K, errors.loss),
    }
    for prefix in ("", REST_PREFIX):
        for name in ("P_systolic", "P_diastolic"):
            inputs[prefix + name] = Normal(now[prefix + name], errors.pressure)
        name = f"{prefix}period"
        inputs[name] = LogNormal(now[name], errors.period)
    return {name: spread for name, spread in inputs.items() if spread is not None}


def _factor(median: Parameter | None, log_sd: float) -> LogNormal | None:
    """A number known up to a factor; None where it is absent or zero, and so has no error."""
    if median is None or not np.all(np.asarray(median) > 0.0):
        return None
    return LogNormal(median, log_sd)
