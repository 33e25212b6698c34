"""Tier 3: records from 3D runs of blood and wall with one physics switched on.

`python -m benchmarks.blind.in_3d DIR --study RESULTS` takes the mesh, the prestress and α of a
finished study (`jaxfsi study ... --quick`) and runs the patient at rest, under dobutamine and under
more of it (held out), once as calibrated and once for each effect that acts on bed or inlet, in the
forms of `truth`; sensors are those of `sensors`. A wall that moves under stress is one of the
causes: under dobutamine the run takes the mesh of the lumen that ultrasound saw then in systole.
`python -m benchmarks.blind diagnose DIR` then diagnoses the records as those of other tiers, and
`python -m benchmarks.blind.score_3d DIR` opens the labels.

The diagnosis is given the curve of the ramp, ΔP = R0 Q + K Q|Q| + L dQ/dt; where the quadratic loss
is withheld, its secant at the drop at rest stands for a and b. Sizes are the geometric means of
their ranges. Runs are kept below DIR: the same command goes on where it was ended.
"""

import argparse
import dataclasses
import math
import pathlib
import shutil
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.blind.cases import OFFSET_SD_MMHG, Setting, seal, write_record
from benchmarks.blind.sensors import seen
from benchmarks.blind.truth import RANGES, SAMPLED, Lanes, TruthCircuit
from lumped import MMHG, MMHG_S_PER_ML, Coronary, Sampled, sampled
from study.case.condition import Condition
from study.run.driven_beat import (
    PHASES,
    Drive,
    DrivenBeat,
    driven_beat,
    fingerprint,
    known_difference,
)
from study.run.finished_study import FinishedStudy, finished_study
from study.run.progress import Progress
from study.run.run_context import RunContext
from study.run.study_context import open_context
from study.store.cache_folder import use_cache

SOFT_WALL, SOFTER = "softer_wall", 0.25
"""A wall with another modulus than the study's, which is no effect of the catalogue; the factor."""

NARROWED, NARROW_STATE = "stress_narrowing", "dobutamine_systole"
"""A lumen that stress narrows, and the measured state whose mesh has it."""

NULL = "none"

CAUSES = (
    NULL, "wire_drift", "catheter_damping", "quadratic_loss", "vasodilation", "stress_compliance",
    "intramyocardial_pump", "aortic_waveform", "back_pressure", NARROWED, SOFT_WALL,
)  # fmt: skip
"""The cause of each record, those that cost no run first."""

IN_GEOMETRY = ("quadratic_loss",)
"""Effects that the 3D model has by itself: they are withheld from the diagnosis."""

BY_MESH = (NARROWED, SOFT_WALL)
"""Causes that change mesh or wall, and nothing that drives a run."""

PLAIN = "plain"
"""Begins the folders of runs without any effect."""

STRONGER = (1.09, 1.06, 0.85)
"""Systolic, diastolic pressure and period of the held-out condition over those of dobutamine."""


class Condition3D(NamedTuple):
    """A condition of the records.

    Attributes:
        entry: its pressures and period.
        flags: stress, adenosine, dobutamine.
        held_out: whether only its aortic pressure may be used.
    """

    entry: Condition
    flags: tuple[float, float, float]
    held_out: bool


def conditions_of(study: FinishedStudy) -> tuple[Condition3D, ...]:
    """Rest, dobutamine, and more of it, of the patient of a study.

    Raises:
        ValueError: the study's case has no dobutamine.
    """
    known = study.context.case.conditions
    if "dobutamine" not in known:
        raise ValueError("The study ran no condition dobutamine. Take one whose case has it.")
    high, low, period = STRONGER
    usual = known["dobutamine"]
    more = dataclasses.replace(
        usual,
        name="dobutamine_high",
        P_systolic=high * float(usual.P_systolic),
        P_diastolic=low * float(usual.P_diastolic),
        period=period * usual.period,
        waveform=None,
    )
    return (
        Condition3D(known["rest"], (0.0, 0.0, 0.0), False),
        Condition3D(usual, (1.0, 0.0, 1.0), False),
        Condition3D(more, (1.0, 0.0, 1.0), True),
    )


def lanes_of(study: FinishedStudy, cause: str, size: float) -> Lanes:
    """The patient's conditions as lanes of `truth`, with one effect."""
    conditions = conditions_of(study)
    one = np.ones(len(conditions))
    lanes: Lanes = {name: one for name in ("C_a", "C_im", "C0", "R0")}
    lanes["alpha"] = study.alpha * one
    flags = np.array([c.flags for c in conditions])
    lanes["stress"], lanes["adenosine"], lanes["dobutamine"] = flags.T
    lanes["order"] = np.arange(len(conditions), dtype=float)
    lanes["period"] = np.array([c.entry.period for c in conditions])
    for name in ("P_systolic", "P_diastolic"):
        lanes[name] = np.array([float(getattr(c.entry, name)) for c in conditions]) / MMHG
    acts = cause in RANGES and cause not in (*IN_GEOMETRY, *BY_MESH)
    lanes["sizes"] = {cause: size * one} if acts else {}
    return lanes


def drives_of(study: FinishedStudy, lanes: Lanes, differences: list[np.ndarray]) -> list[Drive]:
    """What drives the run of each lane.

    Args:
        study: gives the patient.
        lanes: its conditions.
        differences: between ostium and inlet of each, see `study.run.driven_beat.Drive`.
    """
    plain, n = TruthCircuit(lanes), len(lanes["period"])
    at = [np.full(n, phase) for phase in PHASES]
    P_aorta = np.stack([plain.inlet(phase) for phase in at], axis=-1)
    P_muscle = np.stack([plain.muscle(phase) for phase in at], axis=-1)
    drives = []
    for k, condition in enumerate(conditions_of(study)):
        period = condition.entry.period

        def wave(P: np.ndarray, period: float = period) -> Sampled:
            return sampled(PHASES * period, P * MMHG, period, kind="cubic")

        bed = Coronary(
            P_im=wave(P_muscle[k]),
            R_1=plain.R_1[k] * MMHG_S_PER_ML,
            R_2=plain.R_2[k] * MMHG_S_PER_ML,
            R_3=plain.R_3[k] * MMHG_S_PER_ML,
            C_a=plain.C_a[k] / MMHG,
            C_im=plain.C_im[k] / MMHG,
            P_venous=plain.size("back_pressure")[k] * MMHG,
        )
        drives.append(Drive(condition.entry, bed, wave(P_aorta[k]), differences[k]))
    return drives


def differences_of(study: FinishedStudy, context: RunContext, passes: int) -> list[np.ndarray]:
    """Pressure at the ostium over that at the inlet, in each condition [mmHg].

    At first as the study's own runs have shown it, where the condition was another one; each
    further pass takes it from plain runs with that of the pass before.
    """
    conditions, lanes = conditions_of(study), lanes_of(study, NULL, 0.0)
    found = [known_difference(study.calibrated, c.entry) for c in conditions]
    for k in range(1, passes):
        found = [
            driven_beat(context, f"{PLAIN}{_mark(k)}-{drive.entry.name}", drive).difference
            for drive in drives_of(study, lanes, found)
        ]
    return found


def _mark(k: int) -> str:
    """What distinguishes the folders of a pass."""
    return "" if k == 1 else str(k)


def beats_of(
    study: FinishedStudy, context: RunContext, cause: str, size: float, passes: int = 1
) -> list[DrivenBeat]:
    """The beat of each condition with an effect; those that it does not change are run once."""
    differences = differences_of(study, context, passes)
    usual = drives_of(study, lanes_of(study, NULL, 0.0), differences)
    changed = drives_of(study, lanes_of(study, cause, size), differences)
    beats = []
    for drive, plain in zip(changed, usual, strict=True):
        moved = cause == NARROWED and drive.entry.kind != "rest"
        own = _narrowed(context) if moved else context
        image = context.case.conditions["dobutamine"].P_systolic if moved else None
        drive = drive._replace(P_image=image)
        same = fingerprint((drive.bed, drive.P_ostium)) == fingerprint((plain.bed, plain.P_ostium))
        label = f"{PLAIN if same and not moved else cause}{_mark(passes)}"
        context.progress.step(f"3D: {drive.entry.name}, {label}")
        beats.append(driven_beat(own, f"{label}-{drive.entry.name}", drive))
    return beats


def _narrowed(context: RunContext) -> RunContext:
    """The same with the mesh of the lumen under stress."""
    folder = context.folder / NARROWED
    return open_context(context.case, folder, context.choice, context.progress, NARROW_STATE)[0]


def size_of(cause: str, rng: np.random.Generator, curve: tuple[float, ...]) -> float:
    """Size of an effect [its unit]; its sign is drawn where it has one."""
    if cause == NULL:
        return 0.0
    if cause == SOFT_WALL:
        return SOFTER
    if cause == NARROWED:
        return math.nan  # follows from the runs, see `narrowing_of`
    if cause in IN_GEOMETRY:
        return curve[1]
    low, high, signed = RANGES[cause]
    size = math.sqrt(low * high)
    return -size if signed and rng.random() < 0.5 else size


def make(
    folder: pathlib.Path,
    study: FinishedStudy,
    causes: Sequence[str],
    seed: int,
    sd: float,
    passes: int = 1,
) -> None:
    """Run all causes, write the records in an order that nobody knows, and seal their labels.

    Args:
        folder: where.
        study: gives the patient.
        causes: some of `CAUSES`.
        seed: of signs, order and noise.
        sd: noise of the mean beat [mmHg].
        passes: see `differences_of`.
    """
    rng = np.random.default_rng(seed)
    curve = tuple(max(part, 0.0) / MMHG_S_PER_ML for part in study.ramp)
    sizes = {cause: size_of(cause, rng, curve) for cause in CAUSES}
    beats_by_cause = {
        cause: beats_of(study, _context(study, folder, cause), cause, sizes[cause], passes)
        for cause in CAUSES
        if cause in causes
    }
    labels, truth = [], []
    plain = beats_of(study, _context(study, folder, NULL), NULL, 0.0, passes)
    for k, cause in enumerate(rng.permutation(list(beats_by_cause)).tolist()):
        size, beats = sizes[cause], beats_by_cause[cause]
        lanes = lanes_of(study, cause, size)
        step = PHASES.size // SAMPLED
        true = {n: np.stack([getattr(b, w)[::step] for b in beats]) for n, w in _TRACES.items()}
        traces = seen(true, lanes)
        secant = _secant(curve, float((true["P_aorta"] - true["P_distal"])[0].mean()))
        prior = _prior(curve, cause, secant)
        settings = [
            Setting(
                c.entry.name,
                "none" if c.entry.kind == "rest" else "dobutamine",
                c.held_out,
                c.entry.period,
                (
                    float(c.entry.P_systolic) / MMHG + 2.0 * rng.standard_normal(),
                    float(c.entry.P_diastolic) / MMHG + 2.0 * rng.standard_normal(),
                ),
                {name: wave[i] for name, wave in traces.items()},
            )
            for i, c in enumerate(conditions_of(study))
        ]
        place = folder / f"noise-{sd:g}" / f"case-{k:04d}"
        write_record(place, prior, settings, rng, sd, OFFSET_SD_MMHG)
        if cause == NARROWED:
            size = narrowing_of(beats[1], plain[1])
        apart = float(np.sqrt(np.mean((beats[-1].P_distal - plain[-1].P_distal) ** 2)))
        labels.append({**label_of(cause, size, math.log(curve[0] / secant)), "apart": apart})
        truth.append(traces["P_distal"][-1])
    np.save(folder / "held_out_truth.npy", np.stack(truth))
    seal(folder, labels)


def narrowing_of(beat: DrivenBeat, plain: DrivenBeat) -> float:
    """Ln of the ratio of mean drop over mean flow in two runs [-]."""
    narrow, usual = ((b.P_ostium - b.P_distal).mean() / b.Q.mean() for b in (beat, plain))
    return float(np.log(narrow / usual))


def label_of(cause: str, size: float, smaller: float) -> dict:
    """What acts in a record that the base model lacks: kind, and sizes with the cause first.

    Args:
        cause: one of `CAUSES`.
        size: its size.
        smaller: ln of a over the secant, by which R0 is too large where the secant was given.
    """
    kind = {NULL: "none", SOFT_WALL: "outside"}.get(cause, "single")
    if cause in IN_GEOMETRY:
        return {"kind": "pair", "sizes": {cause: size, "proximal_resistance": smaller}}
    return {"kind": kind, "sizes": {} if cause == NULL else {cause: size}}


_TRACES = {"P_aorta": "P_ostium", "P_distal": "P_distal", "Q": "Q"}


def _context(study: FinishedStudy, folder: pathlib.Path, cause: str) -> RunContext:
    """Where the runs of a cause are kept; the prestress is that of the study, where it fits."""
    context = dataclasses.replace(study.context, folder=folder)
    if cause == SOFT_WALL:
        wall = dataclasses.replace(context.case.wall, E=SOFTER * context.case.wall.E)
        case = dataclasses.replace(context.case, wall=wall)
        return dataclasses.replace(context, case=case, folder=folder / SOFT_WALL)
    stages = folder / "stages"
    stages.mkdir(parents=True, exist_ok=True)
    for path in (study.context.folder / "stages").glob("prestress-*.npz"):
        if not (stages / path.name).exists():
            shutil.copy(path, stages)
    return context


def _secant(curve: tuple[float, ...], drop: float) -> float:
    """ΔP/Q at a drop [mmHg·s/mL]."""
    a, b, _ = curve
    return 0.5 * (a + math.sqrt(a**2 + 4.0 * b * drop))


def _prior(curve: tuple[float, ...], cause: str, secant: float) -> list[str]:
    """What the diagnosis knows of the ostium: the ramp's curve, or a resistance for a and b."""
    a, b, L = curve
    if cause in IN_GEOMETRY:
        return [f"R0_mmHg_s_per_ml = {{ value = {secant:.6g}, sd_log = 0.15 }}",
                f"L_mmHg_s2_per_ml = {L:.6g}"]  # fmt: skip
    return [f"R0_mmHg_s_per_ml = {{ value = {a:.6g}, sd_log = 0.15 }}",
            f"K_mmHg_s2_per_ml2 = {b:.6g}", f"L_mmHg_s2_per_ml = {L:.6g}"]  # fmt: skip


def main() -> int:
    """Make the records."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blind.in_3d",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--study", type=pathlib.Path, required=True, help="a finished study")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--noise", type=float, default=0.5)
    parser.add_argument("--passes", type=int, default=1, help="of the pressure at the ostium")
    parser.add_argument("--causes", nargs="+", choices=CAUSES, default=CAUSES)
    options = parser.parse_args()
    use_cache()
    with Progress() as progress:
        study = finished_study(options.study, progress)
        given = (options.causes, options.seed, options.noise, options.passes)
        make(options.folder, study, *given)
    return 0


if __name__ == "__main__":
    sys.exit(main())
