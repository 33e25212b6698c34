"""Patients of the foreign records: parameters of the base circuit and the conditions measured.

mmHg, mL and s throughout this package. Source of the nominal values and of the stress rule: Puelz
et al. 2024; sizes of the changes under the drugs: usual responses in the catheter laboratory.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from lumped.nominal import C0_NOMINAL, NOMINAL
from lumped.units import MMHG

R0_NOMINAL = 3.75
"""Nominal resistance of the proximal vessel [mmHg·s/mL]."""

ALPHA_NOMINAL = 0.25

PRIOR_SD_LOG = {"alpha": 1.0, "R0": 0.15, "C_a": 0.4, "C_im": 0.4, "C0": 0.4}
"""What is unknown of a patient, with the standard deviation of each logarithm."""

STATED_SD = 2.0
"""Standard deviation of a stated systolic or diastolic pressure [mmHg]."""

STRESS = {"R_2": 0.5, "C_a": 2.0, "C_im": 2.0}
"""Factors of the bed under any drug (the rule as printed)."""

Parameters = dict[str, float]
"""Circuit parameters by name: R_0, L, C_0, R_1, R_2, R_3, C_a, C_im, P_v, squeeze and others."""


class ForeignCondition(NamedTuple):
    """A condition of a record.

    Attributes:
        name: its name.
        drug: none, adenosine or dobutamine.
        order: place in time.
        held_out: whether it is kept for the final check.
        P_systolic, P_diastolic: true aortic pressures [mmHg].
        period: mean length of a beat [s].
    """

    name: str
    drug: str
    order: int
    held_out: bool
    P_systolic: float
    P_diastolic: float
    period: float

    @property
    def stressed(self) -> bool:
        """Whether a drug is given."""
        return self.drug != "none"

    @property
    def dose(self) -> float:
        """Strength of the stress: 0 at rest, 1 with a drug, 1.5 with the higher dobutamine."""
        return 0.0 if not self.stressed else 1.5 if self.name == "dobutamine_high" else 1.0


@dataclasses.dataclass(frozen=True)
class ForeignPatient:
    """True parameters of a patient [mmHg, mL, s].

    Attributes:
        alpha: scale of the resistances of the bed [-].
        R0: resistance of the proximal vessel.
        C0: its compliance.
        C_a, C_im: compliances of the bed at rest.
        conditions: what is measured.
    """

    alpha: float
    R0: float
    C0: float
    C_a: float
    C_im: float
    conditions: tuple[ForeignCondition, ...]

    def scaled(self, name: str, factor: float) -> "ForeignPatient":
        """The patient with one parameter multiplied."""
        return dataclasses.replace(self, **{name: getattr(self, name) * factor})


def draw_patient(rng: np.random.Generator) -> ForeignPatient:
    """A patient around the nominal one, inside the priors that the records' format states."""

    def about(nominal: float, sd_log: float, reach: float = 2.0) -> float:
        return nominal * float(np.exp(sd_log * np.clip(rng.normal(), -reach, reach)))

    return ForeignPatient(
        alpha=about(ALPHA_NOMINAL, 0.5),
        R0=about(R0_NOMINAL, 0.4),
        C0=about(C0_NOMINAL * MMHG, 0.35),
        C_a=about(NOMINAL["C_a"] * MMHG, 0.35),
        C_im=about(NOMINAL["C_im"] * MMHG, 0.35),
        conditions=_conditions(rng),
    )


def _conditions(rng: np.random.Generator) -> tuple[ForeignCondition, ...]:
    high, low = rng.normal(112.0, 8.0), rng.normal(66.0, 5.0)
    T = float(np.clip(rng.normal(0.78, 0.08), 0.62, 1.0))

    def near(name: str, drug: str, order: int, up: float, lift: float, rate: float):
        P_systolic = float(np.clip(high + up, 80.0, 190.0))
        P_diastolic = float(np.clip(low + lift, 42.0, P_systolic - 22.0))
        held_out = name == "dobutamine_high"
        period = max(T * rate, 0.33)
        return ForeignCondition(name, drug, order, held_out, P_systolic, P_diastolic, period)

    n, u = rng.normal, rng.uniform
    up, lift, rate = n(22.0, 7.0), n(2.0, 5.0), u(0.55, 0.68)
    last = rng.random() < 0.3
    places = (3, 1, 2) if last else (1, 2, 3)  # adenosine, dobutamine, dobutamine_high
    found = [
        near("rest", "none", 0, 0.0, 0.0, 1.0),
        near("adenosine", "adenosine", places[0], n(-8.0, 5.0), n(-8.0, 4.0), u(0.72, 0.9)),
        near("dobutamine", "dobutamine", places[1], up, lift, rate),
        near(
            "dobutamine_high", "dobutamine", places[2], up + n(10.0, 3.0), lift + n(1.0, 2.0),
            rate * u(0.82, 0.93),
        ),
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda c: c.order))


def base_parameters(patient: ForeignPatient, condition: ForeignCondition) -> Parameters:
    """Parameters of the base circuit of a patient in a condition."""
    rule = STRESS if condition.stressed else {}
    bed = {
        name: patient.alpha * NOMINAL[name] / MMHG * rule.get(name, 1.0)
        for name in ("R_1", "R_2", "R_3")
    }
    return {
        **bed,
        "R_0": patient.R0,
        "C_0": patient.C0,
        "C_a": patient.C_a * rule.get("C_a", 1.0),
        "C_im": patient.C_im * rule.get("C_im", 1.0),
        "L": 0.0,
        "P_v": 0.0,
        "squeeze": 1.0,
        "kappa": 0.0,
    }
