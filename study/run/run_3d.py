"""3D runs of one patient, each kept by the hash of what it follows from.

A run is a condition with a scale factor α and a stress rule. Its folder holds fields, history and
checkpoint as those of the command `simulate` do, and in ``inputs.txt`` the key of what they follow
from and by which code they were begun; what the study needs of it is kept as a stage.
"""

import dataclasses
import json
import pathlib
from typing import Any, NamedTuple

import numpy as np

from jaxfsi import Mesh
from jaxfsi.core.step.state import State
from jaxfsi.fields import read_series
from jaxfsi.simulation import Record
from jaxfsi.simulation.record import port_flow, port_pressure
from jaxfsi.text_files import regular_text
from lumped import ML_PER_MIN, MMHG
from lumped.whole_files import write_whole
from study.case.model import Case
from study.run.aortic_site import cycle_offsets, site_pressures
from study.run.cycles import cycle_means
from study.run.openings import ANOMALOUS, INLET, distal_name, inlet_of
from study.run.progress import Progress
from study.run.setup import Setup, plan_steps, prepare_simulation
from study.run.simulation import Outcome, run_simulation
from study.store.earlier_run import clear_run
from study.store.provenance import made_now, now
from study.store.result_files import FIELD_FOLDER, RUN_FOLDER, STAGE_FOLDER
from study.store.stages import Stages, stage_key

INPUTS_FILE = "inputs.txt"
_MOST_SAMPLES = 400


@dataclasses.dataclass(frozen=True)
class RunChoice:
    """How runs are made.

    Attributes:
        dt: longest step [s]; None: as the case says.
        cycles: of a run.
        continued: whether stress goes on from the end of rest, as in the paper, instead of
            starting from its own periodic state in 0D.
    """

    dt: float | None = None
    cycles: int = 1
    continued: bool = False


class RunName(NamedTuple):
    """Which run.

    Attributes:
        label: begins the name of its folder: what its α is, or which trial.
        condition: name of the condition.
        rule: stress rule; None at rest.
        alpha: scale of the resistances of the anomalous outlet.
    """

    label: str
    condition: str
    rule: str | None
    alpha: float

    @property
    def folder(self) -> str:
        """Name of its folder."""
        return "-".join(part for part in (self.label, self.condition, self.rule) if part)


@dataclasses.dataclass(frozen=True)
class Bench:
    """What all runs of a patient share.

    Attributes:
        case: the case; its surrogate is the curve of the ramp once that is known.
        mesh: its mesh.
        mesh_key: hash of the mesh.
        folder: of the study.
        choice: how runs are made.
        progress: told of each.
        site: nodes where the aortic pressure is read (`study.run.aortic_site`); None: at the inlet.
        mesh_made: when and by which code the mesh was made.
        begun: when the command that is at work began.
    """

    case: Case
    mesh: Mesh
    mesh_key: str
    folder: pathlib.Path
    choice: RunChoice
    progress: Progress
    site: np.ndarray | None = None
    mesh_made: dict[str, Any] | None = None
    begun: str = dataclasses.field(default_factory=now)

    @property
    def stages(self) -> Stages:
        """Where stages are kept."""
        return Stages(self.folder / STAGE_FOLDER)

    def keep(self, P_image: float, found: Any) -> np.ndarray:
        """A prestress that was found before, see `study.run.setup.Keep`."""
        wall = self.case.wall
        key = stage_key("prestress", self.mesh_key, wall, P_image)
        name = f"prestress-{P_image / MMHG:.6g}-mmHg"
        return self.stages.arrays(name, key, lambda: {"stress": found()})["stress"]

    def run_folder(self, name: str) -> pathlib.Path:
        """Folder of a run."""
        return self.folder / RUN_FOLDER / name

    def prepared(self, key: str, name: str) -> pathlib.Path:
        """The folder of a run; what another input left there is forgotten."""
        folder, mark = self.run_folder(name), self.run_folder(name) / INPUTS_FILE
        folder.mkdir(parents=True, exist_ok=True)
        if not mark.is_file() or mark.read_text(encoding="utf-8").split("\n")[0] != key:
            clear_run(folder)
            write_whole(mark, f"{key}\n{json.dumps(made_now())}\n")
        return folder

    def run_begun(self, name: str) -> dict[str, Any] | None:
        """When and by which code the run in a folder was begun; None where that is not known."""
        try:
            text = regular_text(self.run_folder(name) / INPUTS_FILE)
            return dict(json.loads(text.split("\n", 1)[1]))
        except (OSError, ValueError, IndexError, TypeError):
            return None


def run_key(bench: Bench, name: RunName, before: RunName | None = None) -> str:
    """Hash of all that a run follows from.

    Args:
        bench: see `Bench`.
        name: the run.
        before: the run that it goes on from, if any.
    """
    case = bench.case
    rest = case.conditions.get("rest")
    entry = case.conditions[name.condition]
    solver = dataclasses.replace(case.solver, n_steps=None)
    blocks = (case.blood, case.wall, case.coronary, case.surrogate, case.windkessel, solver)
    factors = case.stress.factors if name.rule == "factors" else None
    conditions = tuple(
        None if c is None else dataclasses.replace(c, ffr=None, ffr_sd=None) for c in (rest, entry)
    )
    own = (bench.mesh_key, blocks, conditions, name.condition, name.rule, factors, name.alpha)
    earlier = None if before is None else run_key(bench, before)
    choice = dataclasses.replace(bench.choice, continued=False)
    return stage_key("run", own, choice, earlier)


def fsi_run(bench: Bench, name: RunName, *, before: RunName | None = None) -> dict[str, Any]:
    """A run in 3D, or what was kept of it.

    Args:
        bench: see `Bench`.
        name: the run.
        before: a run at rest whose end it starts from; None: its own periodic state in 0D.

    Returns:
        `ratio` of the last whole cycle, `cycles`, `drift_mmHg`, `blocks`, `history` and how the
        solver did, as the document holds them.

    Raises:
        RuntimeError: a step failed; cause and cure.
        KeyboardInterrupt: the user interrupted it; the checkpoint is kept.
    """
    key = run_key(bench, name, before)

    def compute() -> dict[str, Any]:
        setup = setup_of(bench, name)
        if before is not None:
            setup = dataclasses.replace(setup, state=_continued(bench, before, setup))
        return run_part(bench, setup, finished_run(bench, name.folder, key, setup), name)

    return bench.stages.value(f"run-{name.folder}", stage_key("reading", key, bench.site), compute)


def setup_of(bench: Bench, name: RunName) -> Setup:
    """Model and start of a run."""
    case = bench.case
    if name.rule is not None:
        case = dataclasses.replace(case, stress=dataclasses.replace(case.stress, rule=name.rule))
    plan = plan_steps(case, name.condition, dt=bench.choice.dt, cycles=float(bench.choice.cycles))
    return prepare_simulation(
        case, bench.mesh, name.condition, plan, alpha=name.alpha, keep=bench.keep
    )


def finished_run(bench: Bench, folder: str, key: str, setup: Setup) -> Outcome:
    """A run that went to its end.

    Raises:
        RuntimeError: a step failed.
        KeyboardInterrupt: the user interrupted it.
    """
    place = bench.prepared(key, folder)
    outcome = run_simulation(bench.case, setup, place, bench.progress)
    if outcome.interrupted:
        raise KeyboardInterrupt(
            f"interrupted in the run {folder}; what was computed is in {bench.folder}. "
            "Give the same command again to go on."
        )
    if outcome.failure:
        raise RuntimeError(
            f"The run {folder} ended early. {outcome.failure} What was computed before is in "
            f"{place}; a smaller step (--dt) may help."
        )
    return outcome


def _continued(bench: Bench, before: RunName, setup: Setup) -> State:
    """The end of a run at rest as the start of one under stress: pressures are continuous.

    The state of an intramyocardial node counts from the ventricular pressure, which may differ
    between the two at the start of a cycle.
    """
    rest = setup_of(bench, before)
    end = finished_run(bench, before.folder, run_key(bench, before), rest).state
    assert end is not None
    start = setup.state
    blocks = []
    for old, new, x in zip(rest.model.ports, setup.model.ports, end.blocks, strict=True):
        was, becomes = old.reference_pressure(0.0), new.reference_pressure(0.0)
        blocks.append(x + was - becomes if x.shape == was.shape == becomes.shape else x)
    return end._replace(t=start.t, blocks=tuple(blocks))


def run_part(bench: Bench, setup: Setup, outcome: Outcome, name: RunName) -> dict[str, Any]:
    """What the document holds of a run."""
    record, names, plan = outcome.record, setup.model.names, setup.schedule
    cycles = cycle_means(record, names, plan.period)
    site = _at_site(bench, name, record, names, plan.period, cycles)
    whole = [cycle for cycle in cycles if cycle["complete"]]
    ratios = [cycle["ratio"] for cycle in whole]
    distal = distal_name(names)
    assert distal is not None, "checked by check_study and check_openings"
    return {
        **name._asdict(),
        "ratio": ratios[-1] if ratios else None,
        "ratios": ratios,
        "ratio_change": abs(ratios[-1] - ratios[-2]) if len(ratios) > 1 else None,
        "drift_mmHg": block_drift(setup, outcome.state),
        "cycles": cycles,
        "period_s": plan.period,
        "dt_s": plan.dt,
        "steps": record.n_steps,
        "repeated": len(outcome.events),
        "mean_iterations": float(record.n_linear.mean()),
        "least_volume": float(record.least_volume.min()),
        "folder": f"{RUN_FOLDER}/{name.folder}",
        "history": {**history(record, names, distal), **site},
    }


def _at_site(
    bench: Bench,
    name: RunName,
    record: Record,
    names: tuple[str, ...],
    period: float,
    cycles: list[dict[str, Any]],
) -> dict[str, list[float]]:
    """Take the ratio of each cycle to the aortic pressure at the site; gives its waveform."""
    folder = bench.run_folder(name.folder) / FIELD_FOLDER
    entries = [e for e in read_series(folder / "fields.pvd") if e.t > 0.0]
    if bench.site is None or not entries:
        return {}
    t = np.array([e.t for e in entries])
    P = site_pressures(folder, entries, bench.site)
    offsets = cycle_offsets(t, P - np.interp(t, *inlet_of(record, names)), period, len(cycles))
    for cycle, offset in zip(cycles, offsets, strict=True):
        inlet = cycle["ports"][INLET]["mean_P_mmHg"]
        cycle["site_offset_mmHg"] = offset
        cycle["ratio_to_inlet"] = cycle["ratio"]
        if cycle["ratio"] is not None:
            cycle["ratio"] = cycle["ratio"] * inlet / (inlet + offset)
    return {"t_site_s": [float(v) for v in t], "P_site_mmHg": [float(f"{v:.7g}") for v in P]}


def block_drift(setup: Setup, end: State | None) -> float | None:
    """Largest change of a state of the anomalous bed from start to end of a run [mmHg]."""
    if end is None:
        return None
    changes = [
        float(np.max(np.abs(np.asarray(after) - np.asarray(before))))
        for name, before, after in zip(
            setup.model.names, setup.state.blocks, end.blocks, strict=True
        )
        if name.startswith(ANOMALOUS) and np.size(after)
    ]
    return max(changes, default=0.0) / MMHG


def history(record: Record, names: tuple[str, ...], distal: str) -> dict[str, list[float]]:
    """Pressures of aorta and artery and the flow of the artery, thinned where there are many."""
    some = slice(None, None, max(1, -(-record.n_steps // _MOST_SAMPLES)))
    columns = {
        "t_s": record.t,
        "P_aorta_mmHg": port_pressure(record, names, INLET) / MMHG,
        "P_distal_mmHg": port_pressure(record, names, distal) / MMHG,
        "Q_ml_per_min": port_flow(record, names, distal) / ML_PER_MIN,
    }
    return {key: [float(f"{v:.7g}") for v in values[some]] for key, values in columns.items()}
