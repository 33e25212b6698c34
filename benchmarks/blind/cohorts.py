"""Cohorts whose patients share one cause: what poor records say when they are pooled."""

import pathlib

import numpy as np

from benchmarks.blind.cases import Cases, seal
from benchmarks.blind.diagnoses import diagnoses_of
from benchmarks.blind.truth import RANGES
from diagnosis import Diagnosis
from diagnosis.cohort import pool

NULLS = 3
"""Cohorts without any effect."""

DRAWS, DRAWN = 400, 10
"""Random cohorts drawn from a larger one, and patients in each."""


def pool_cohorts(folder: pathlib.Path, seed: int, patients: int, richness: str) -> str:
    """Pooled verdict on one cohort for every effect and some without, as a Markdown table.

    Of cohorts of more than ten it also says what random tens of their patients lead to.

    Patients of a cohort share the effect; its size, and the sign of a signed one, are their own.

    Args:
        folder: where the records are written.
        seed: of the cases.
        patients: in each cohort.
        richness: what is used of each record.
    """
    causes: list[str | None] = [*RANGES, *[None] * NULLS]
    effects = [cause for cause in causes for _ in range(patients)]
    cases = Cases(seed, len(effects), effects=effects)
    cases.write(folder / "noise-0.5", 0.5)
    seal(folder, cases.labels)
    places = sorted((folder / "noise-0.5").iterdir())
    found = diagnoses_of(places, richness)
    many = patients > DRAWN
    drawn = f" tens: rightly, wrongly, in the set (of {DRAWS}) |" if many else ""
    lines = [
        f"{richness}, {patients} patients a cohort, seed {seed}", "",
        "| cause | alone: named (rightly) | pooled verdict | probability of the cause | of none |"
        + drawn,
        "|---|---|---|---|---|" + "---|" * many,
    ]  # fmt: skip
    rng = np.random.default_rng(seed)
    for k, cause in enumerate(causes):
        members = places[k * patients : (k + 1) * patients]
        group = [found[place] for place in members if place in found]
        pooled = pool(group)
        named = [d.judgement.named for d in group if d.judgement.verdict == "named"]
        right = sum(names == (cause,) for names in named)
        chance = "-" if cause is None else f"{pooled.probabilities[cause]:.3f}"
        said = pooled.verdict + (f": {', '.join(pooled.named)}" if pooled.named else "")
        lines.append(
            f"| {cause or 'none'} | {len(named)} ({right}) | {said} | {chance} | "
            f"{pooled.probabilities['none']:.3f} |"
        )
        if many:
            lines[-1] += _drawn(group, cause, rng)
    return "\n".join(lines)


def _drawn(group: list[Diagnosis], cause: str | None, rng: np.random.Generator) -> str:
    """How often random cohorts of `DRAWN` patients name the cause, another, or a set with it."""
    right = wrong = held = 0
    for _ in range(DRAWS):
        found = pool([group[k] for k in rng.choice(len(group), DRAWN, replace=False)])
        right += found.named == (cause,)
        wrong += found.verdict == "named" and found.named != (cause,)
        held += found.verdict == "ambiguous" and cause in found.named
    return f" {right}, {wrong}, {held} |"
