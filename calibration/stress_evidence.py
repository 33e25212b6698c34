"""What stress does to the bed of a coronary artery and to a slit, from the literature.

Flow reserve C is mean flow under the drug over that at rest in an artery without a stenosis. With
the mean pressures of such a study, P̄_stress/P̄_rest = p, the resistance of the bed under stress over
that at rest is f = p/C. The published rules of Puelz et al. 2024 are two points on that scale: the
equations as printed have f = 0.91, the prose f = 0.5.

| drug | age | C | source |
|---|---|---|---|
| adenosine | adult | 2.91 ± 0.78 | PET of normal controls, PMC3069313 |
| adenosine | child | 1.93 to 2.37 ± 0.4 | Hamaoka et al. 1995, Circulation 92:2457 |
| dobutamine | adult | 2.5 to 3 | Jiang et al. 2022, JTCVS Tech 13:144 (flow × 3); less than |
| | | | adenosine in J. Nucl. Cardiol. 2006, doi 10.1016/j.nuclcard.2006.03.017 |
| dobutamine | child | 2.2, assumed | as adenosine; wider, since no study measured it |

A slit under dobutamine loses area beyond what it loses at rest: the open patient of
`study/data/ivus_aaoca` 10 to 20 % (least area, diastole and systole), children 33 to 44 % between
diastole and systole (ultrasound, J. Invasive Cardiol. 2024), others nothing. Losses go with the
area to the power of −2 to −3. Under adenosine the heart does not contract harder, and little is
assumed.
"""

from typing import NamedTuple

from calibration.spreads import LogNormal

AGES = ("adult", "child", "unknown")


class StressEvidence(NamedTuple):
    """What is known of a patient under a drug before anything is measured there.

    Attributes:
        bed_factor: resistance of the whole bed under stress over that at rest.
        stress_loss: factor of the losses of the anomalous artery.
        source: where both come from.
        pooled: whether drugs or ages are thrown together, since one of them is not known.
    """

    bed_factor: LogNormal
    stress_loss: LogNormal
    source: str
    pooled: bool = False


_RESERVE: dict[tuple[str, str], tuple[float, float, str]] = {
    ("adenosine", "adult"): (2.91, 0.27, "PET of normal adults, PMC3069313"),
    ("adenosine", "child"): (2.2, 0.22, "Hamaoka et al. 1995, Circulation 92:2457"),
    ("dobutamine", "adult"): (2.7, 0.27, "Jiang et al. 2022; J. Nucl. Cardiol. 2006"),
    ("dobutamine", "child"): (2.2, 0.30, "assumed as under adenosine, Hamaoka et al. 1995"),
}
_PRESSURE_RATIO = {"adenosine": 0.95, "dobutamine": 1.08, "other": 1.0}
_LOSS = {"adenosine": (1.0, 0.05), "dobutamine": (1.2, 0.2), "other": (1.1, 0.15)}
_POOLED = 0.35
"""Standard deviation of log C where age or drug is not known."""


def stress_evidence(drug: str = "other", age: str = "unknown") -> StressEvidence:
    """What the literature says of a drug at an age.

    Args:
        drug: adenosine, dobutamine, or other: exercise and unknown drugs.
        age: one of `AGES`; adult from about 18 years on.

    Raises:
        ValueError: no such drug or age.
    """
    if drug not in _LOSS or age not in AGES:
        raise ValueError(
            f"no evidence for drug {drug!r} and age {age!r}: take one of {', '.join(_LOSS)},"
            f" and one of {', '.join(AGES)}"
        )
    if (drug, age) in _RESERVE:
        reserve, log_sd, source = _RESERVE[drug, age]
    else:
        of_drug = [v[0] for (name, _), v in _RESERVE.items() if drug in (name, "other")]
        reserve, log_sd = sum(of_drug) / len(of_drug), _POOLED
        source = "adults and children pooled" if drug != "other" else "drugs and ages pooled"
    pooled = (drug, age) not in _RESERVE
    loss, loss_sd = _LOSS[drug]
    factor = _PRESSURE_RATIO[drug] / reserve
    bed_factor, stress_loss = LogNormal(factor, log_sd), LogNormal(loss, loss_sd)
    return StressEvidence(bed_factor, stress_loss, source, pooled)
