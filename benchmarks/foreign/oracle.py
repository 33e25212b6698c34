"""The oracle: Bayes' rule by a method that knows the generator, to measure others against.

    p(h | y) ∝ p(h) Σ_b p(b | h) ∫ N(y; f + d_b(z) + J u₀, I + J Jᵀ) N(z; 0, I) dz

h is none, an effect of the list or a kind outside of it, b a branch of its drawer (a form, a sign),
z its sizes (`replay`); y is the record's own noisy data, whitened by the noise's true law. It knows
the beats, when each starts, the family of the aortic pressure, the acquisition and the memory of
the noise. It does not know the patient: α, R0, the compliances, the pressures of each condition and
an offset of each trace are integrated out, with the priors that a record states (`visibility`).

What it linearises: data are linear in these unknowns about the true patient without an effect. What
it leaves out: that records which no patient could have are drawn again.
"""

import importlib
import json
import pathlib
import sys
import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.special import logsumexp

from benchmarks.foreign import catalogue, zerod_forms
from benchmarks.foreign.branches import MOST_NODES, evidences
from benchmarks.foreign.check import WAVEFORM
from benchmarks.foreign.clock import Seen
from benchmarks.foreign.effect_runs import Bench, bench
from benchmarks.foreign.patient import ALPHA_NOMINAL, PRIOR_SD_LOG, STATED_SD
from benchmarks.foreign.record import ForeignRecord, Scene
from benchmarks.foreign.replay import Drawer
from benchmarks.foreign.schedule import EFFECTS
from benchmarks.foreign.score import HELD
from benchmarks.foreign.waves import assumed_aorta
from lumped.nominal import C0_NOMINAL, NOMINAL
from lumped.units import MMHG
from lumped.whole_files import write_whole

SHARES = {"none": 0.15, "effect": 0.65, "outside": 0.20}
"""Shares of the truths in a set (`schedule`)."""

CERTAIN, LIKELY, LISTED = 0.9, 0.5, 0.95
"""Probability from which one effect is named; from which none or unknown is the verdict; of the
effects that an ambiguous answer lists, together."""

Answer = dict[str, Any]


DRAWERS_OF = {
    "zerod": zerod_forms.DRAWERS,
    "other_forms": catalogue.DRAWERS,
    "real_clock": catalogue.DRAWERS,
}
"""Drawers of the truths of each generator that the oracle knows."""


def oracle(folder: pathlib.Path, draws: int | None = None, records: int | None = None) -> None:
    """Answer a set and write `answers-oracle.json`; answers that are there already are kept.

    Args:
        folder: a set, see `benchmarks.foreign.make`.
        draws: nodes that each branch of an effect starts with, at most.
        records: only so many of them.

    Raises:
        ValueError: a record is not what its generator and seed give, or the oracle does not know
            the generator.
    """
    content = json.loads((folder / "labels.json").read_text(encoding="utf-8"))
    if content["generator"] not in DRAWERS_OF:
        raise ValueError(
            f"{folder} is of the generator {content['generator']}, which the oracle does not know;"
            f" it knows {', '.join(DRAWERS_OF)}."
        )
    file = folder / "answers-oracle.json"
    answers = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    module = importlib.import_module(f"benchmarks.foreign.{content['generator']}")
    for name in sorted(content["records"])[:records]:
        if name in answers:
            continue
        record: ForeignRecord = module.draw(content["seed"], int(name))
        place = folder / "records" / name
        read = {f: (place / f).read_text(encoding="utf-8") for f in record.files}
        _check(name, read, record.files)
        answers[name] = answered(record.scene, read, content["generator"], draws or MOST_NODES)
        write_whole(file, json.dumps(answers, indent=0) + "\n")
        print(f"{len(answers)} of {len(content['records'])}", file=sys.stderr, flush=True)


def _check(name: str, read: Mapping[str, str], drawn: Mapping[str, str]) -> None:
    """Both give the same traces, but for the last digit."""
    for file in drawn:
        if file.endswith(".csv"):
            one, other = traces(read[file]), traces(drawn[file])
            if one.shape != other.shape or np.abs(one - other).max() > 0.01:
                raise ValueError(
                    f"{name}/{file} is not what the set's generator and seed draw. "
                    "Answer it with the version that made the set, or make the set anew."
                )


def traces(text: str) -> np.ndarray:
    """Rows of time [s], aortic and distal pressure [mmHg]."""
    return np.array([line.split(",") for line in text.splitlines()[1:]], float)


def hypotheses(drawers: Mapping[str, Drawer]) -> dict[str, float]:
    """Prior probability of every truth."""
    kinds = [name for name in drawers if name.startswith("outside:")]
    return {
        "none": SHARES["none"],
        **{name: SHARES["effect"] / len(EFFECTS) for name in EFFECTS},
        **{name: SHARES["outside"] / len(kinds) for name in kinds},
    }


def answered(
    scene: Scene, files: Mapping[str, str], generator: str, nodes: int = MOST_NODES
) -> Answer:
    """The answer to one record.

    Args:
        scene: what it was made of; of its effect nothing is used.
        files: its written text.
        generator: its name.
        nodes: that each branch of an effect starts with, at most.
    """
    b = bench(scene)
    r = residual(b, files)
    prior = hypotheses(DRAWERS_OF[generator])
    found = evidences(b, r, {n: DRAWERS_OF[generator][n] for n in prior if n != "none"}, nodes)
    log = {name: np.log(prior[name]) + value for name, value in {**found, "none": 0.0}.items()}
    total = logsumexp(list(log.values()))
    other = any(plan.family is not assumed_aorta for plan in scene.plans.values())
    return verdict(named({name: float(np.exp(v - total)) for name, v in log.items()}, other=other))


def residual(b: Bench, files: Mapping[str, str]) -> np.ndarray:
    """Whitened data minus the base model's at the centre of what is known, y − f − J u₀.

    Args:
        b: scene and base model.
        files: the record's written text.
    """
    toml = tomllib.loads(files["record.toml"])
    seen, pressures = [], []
    for c in b.conditions:
        table, rows = toml["condition"][c.name], traces(files[f"{c.name}.csv"])
        flow = float(table["mean_flow_ml_per_min"])
        seen.append(Seen(rows[:, 1], rows[:, 2], flow, float(table["ffr"])))
        for key, true in (("P_systolic", c.P_systolic), ("P_diastolic", c.P_diastolic)):
            pressures.append((table[f"{key}_mmHg"] - true) / STATED_SD)
    patient = b.scene.patient
    nominal = {
        "alpha": ALPHA_NOMINAL,
        "R0": toml["surrogate"]["R0_mmHg_s_per_ml"]["value"],
        "C_a": NOMINAL["C_a"] * MMHG,
        "C_im": NOMINAL["C_im"] * MMHG,
        "C0": C0_NOMINAL * MMHG,
    }
    centre = [
        np.log(nominal[name] / getattr(patient, name)) / sd for name, sd in PRIOR_SD_LOG.items()
    ]
    u = np.zeros(b.unknowns.columns.shape[1])
    u[: len(centre) + len(pressures)] = [*centre, *pressures]
    return b.whitened(seen) - b.origin - b.unknowns.columns @ u


def named(truths: Mapping[str, float], *, other: bool) -> dict[str, float]:
    """Probabilities of hypotheses as a set scores them, from those of truths.

    Args:
        truths: probability of every truth.
        other: whether the aortic waveform is of another family: then none is called the effect
            `aortic_waveform`, which the scorer strikes out where there is another effect.
    """
    found: dict[str, float] = {}
    for truth, p in truths.items():
        name = HELD.get(truth, "unknown" if truth.startswith("outside:") else truth)
        name = WAVEFORM if name == "none" and other else name
        found[name] = found.get(name, 0.0) + p
    return found


def verdict(probabilities: Mapping[str, float]) -> Answer:
    """The answer that probabilities give."""
    order = sorted(probabilities, key=lambda name: -probabilities[name])
    first, effects = order[0], [name for name in order if name not in ("none", "unknown")]
    p = probabilities[first]
    if first in ("none", "unknown") and p >= LIKELY:
        said, names = {"none": "no_gap", "unknown": "unknown"}[first], []
    elif first in effects and p >= CERTAIN:
        said, names = "named", [first]
    else:
        before = np.cumsum([0.0, *(probabilities[name] for name in effects)])
        said = "ambiguous"
        names = [n for n, sum_ in zip(effects, before, strict=False) if sum_ < LISTED * before[-1]]
    kept = {name: round(probabilities[name], 6) for name in order if probabilities[name] > 5e-7}
    return {"verdict": said, "named": names, "probabilities": kept}
