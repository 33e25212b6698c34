"""A 3D run whose anomalous bed and aortic pressure are given, in place of those of its case.

The pressure is wanted at the ostium, where a catheter measures it, and prescribed at the inlet of
the aorta. Between the two lies a difference of 1 to 2 mmHg, inertia and velocity head of the blood
in the aorta, which a run of the study has shown; the inlet takes the pressure less that. The blood
starts at rest: the first quarter of a beat is run and forgotten, the beat after it is kept.
"""

import dataclasses
import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxfsi.core.step.state import initial_state
from jaxfsi.fields import read_series
from jaxfsi.fields.aortic_site import site_pressures
from jaxfsi.opening import INLET, distal_name, is_anomalous
from jaxfsi.simulation import StepHistory
from jaxfsi.simulation.record import port_flow, port_pressure
from lumped import (
    MMHG,
    AbstractElement,
    AbstractWaveform,
    PressureSource,
    Vessel,
    connect,
    sampled,
    solve_periodic,
)
from study.case.condition import Condition
from study.run.case_model import case_model
from study.run.patient import stress_rules
from study.run.results import Run3D
from study.run.run_3d import finished_run
from study.run.run_context import RunContext
from study.run.setup import image_pressure, outlets_of, plan_steps
from study.run.simulation_data import Setup
from study.store.result_files import FIELD_FOLDER
from study.store.stages import stage_key

PHASES = np.arange(256) / 256
"""Instants of a beat that is kept, in beats."""

BEATS = 1.25
"""Beats of a run; the last one is kept."""

Wave = Float[np.ndarray, " n"]


class Drive(NamedTuple):
    """What drives a run.

    Attributes:
        entry: pressures and period of the condition; its systolic pressure goes to the beds of
            other arteries, its output and pressures to the Windkessel of the aorta.
        bed: block behind the anomalous outlet.
        P_ostium: pressure wanted in the aorta at the ostium [dyn/cm²].
        difference: of the pressure at the ostium over that at the inlet, at `PHASES` [mmHg].
        P_image: pressure of the blood in the image that the mesh is from [dyn/cm²]; None: see
            `setup.image_pressure`.
    """

    entry: Condition
    bed: AbstractElement
    P_ostium: AbstractWaveform
    difference: Wave
    P_image: float | None = None

    @property
    def P_inlet(self) -> AbstractWaveform:
        """Pressure prescribed at the inlet of the aorta [dyn/cm²]."""
        t = PHASES * self.entry.period
        P = np.asarray(jax.vmap(self.P_ostium)(jnp.asarray(t))) - self.difference * MMHG
        return sampled(t, P, self.entry.period, kind="cubic")

    def image_pressure(self, context: RunContext) -> float:
        """Pressure of the blood in the image that the mesh is from [dyn/cm²]."""
        return image_pressure(context.case, "rest") if self.P_image is None else self.P_image


class DrivenBeat(NamedTuple):
    """The beat of a run, at `PHASES`.

    Attributes:
        P_ostium: pressure in the aorta at the ostium [mmHg]; at its inlet where the anatomy does
            not tell where the ostium lies.
        P_distal: pressure at the anomalous outlet [mmHg].
        Q: flow through it [mL/s].
        difference: of the pressure at the ostium over that at the inlet [mmHg].
    """

    P_ostium: Wave
    P_distal: Wave
    Q: Wave
    difference: Wave


def driven_beat(context: RunContext, folder: str, drive: Drive) -> DrivenBeat:
    """The beat of a run in 3D, or what was kept of it.

    Args:
        context: case, mesh, and the folder where runs and stages are kept.
        folder: name of the run.
        drive: what drives it.

    Raises:
        RuntimeError: a step failed; cause and cure.
        KeyboardInterrupt: the user interrupted it; the checkpoint is kept.
    """
    key = drive_key(context, drive)

    def compute() -> dict[str, list[float]]:
        setup = drive_setup(context, drive)
        outcome = finished_run(context, folder, key, setup)
        beat = _beat(context, folder, outcome.record, setup)
        return {name: [float(f"{v:.7g}") for v in wave] for name, wave in beat._asdict().items()}

    stage = stage_key("reading", key, context.site)

    def read(kept: Mapping[str, Sequence[float]]) -> DrivenBeat:
        return DrivenBeat(**{name: np.array(wave, float) for name, wave in kept.items()})

    return context.stages.value(f"beat-{folder}", stage, compute, read)


def drive_key(context: RunContext, drive: Drive) -> str:
    """Hash of all that a run follows from: the case, the mesh, and what drives it."""
    case = context.case
    solver = dataclasses.replace(case.solver, n_steps=None, cycles=None)
    entry = drive.entry.without_outcome()
    parts = (case.blood, case.wall, *case.beds, case.surrogate, case.windkessel, case.stress)
    image = float(drive.image_pressure(context))
    given = (fingerprint(drive.bed), fingerprint(drive.P_inlet))
    step = context.choice.dt
    return stage_key(
        "driven run", context.mesh_key, parts, solver, entry, image, given, step, BEATS
    )


def fingerprint(tree: Any) -> str:
    """Hash of the structure of a block or waveform and of all its numbers."""
    leaves, structure = jax.tree.flatten(tree)
    digest = hashlib.sha256(str(structure).encode())
    for leaf in leaves:
        numbers = np.asarray(leaf)
        digest.update(f"{numbers.dtype} {numbers.shape}".encode() + numbers.tobytes())
    return digest.hexdigest()[:32]


def drive_setup(context: RunContext, drive: Drive) -> Setup:
    """Model and start of a run.

    Raises:
        RuntimeError: no periodic state of the bed was found.
    """
    own, mesh, name = context.case, context.mesh, drive.entry.name
    case = dataclasses.replace(own, conditions={**own.conditions, name: drive.entry})
    rule = None if drive.entry.kind == "rest" else stress_rules(case)[case.stress.rule]
    outlets = outlets_of(case, name, mesh, 1.0, rule)
    anomalous = [opening for opening in mesh.openings if is_anomalous(opening)]
    start = _start(context, drive)
    outlets = dataclasses.replace(
        outlets,
        alpha_origin="in the given bed",
        blocks={**outlets.blocks, **dict.fromkeys(anomalous, drive.bed)},
        starts={**outlets.starts, **dict.fromkeys(anomalous, start)},
    )
    inlet = drive.P_inlet
    ports = outlets.ports(inlet, mesh.openings)
    model = case_model(case, mesh, ports, drive.image_pressure(context), keep=context.keep)
    state = initial_state(model, p=inlet(0.0), blocks=outlets.starts_of(model.names))
    plan = plan_steps(case, name, dt=context.choice.dt, cycles=BEATS)
    return Setup(mesh, model, state, inlet, outlets, plan)


def _start(context: RunContext, drive: Drive) -> jax.Array:
    """Periodic states of the bed behind the surrogate of its artery, at the start of a beat."""
    known = context.case.surrogate
    artery = Vessel(R_viscous=known.R0 or 0.0, C=known.C0, K_stenosis=known.K)
    network = connect(
        {
            "inlet": (PressureSource(drive.P_ostium), "aorta"),
            "artery": (artery, "aorta", "distal"),
            "bed": (drive.bed, "distal"),
        }
    )
    solution = solve_periodic(network, drive.entry.period)
    names = drive.bed.state_names
    return jnp.stack([solution.state("bed", name)[0] for name in names])


def _beat(context: RunContext, folder: str, record: StepHistory, setup: Setup) -> DrivenBeat:
    names, period = setup.model.names, setup.schedule.period
    end = setup.schedule.n_steps * setup.schedule.dt
    t = end - np.mod(end / period - PHASES, 1.0) * period
    distal = distal_name(names)
    assert distal is not None, "checked by check_openings"
    P_inlet = port_pressure(record, names, INLET) / MMHG
    difference = np.zeros(PHASES.size)
    frames = context.run_folder(folder) / FIELD_FOLDER
    entries = [e for e in read_series(frames / "fields.pvd") if e.t > 0.0]
    if context.site is not None and entries:
        seen = np.array([e.t for e in entries])
        there = site_pressures(frames, entries, context.site)
        difference = np.interp(t, seen, there - np.interp(seen, record.t, P_inlet))
    return DrivenBeat(
        np.interp(t, record.t, P_inlet) + difference,
        np.interp(t, record.t, port_pressure(record, names, distal) / MMHG),
        np.interp(t, record.t, port_flow(record, names, distal)),
        difference,
    )


def known_difference(runs: Sequence[Run3D], entry: Condition) -> Wave:
    """Pressure at the ostium over that at the inlet, as a study's runs have shown it [mmHg].

    Of the calibrated run in the same condition, else of the one of the same kind whose period is
    nearest; zero where no run shows it.

    Args:
        runs: those of a study with α as calibrated.
        entry: the condition.
    """
    read = [r for r in runs if r.history.has_site]
    alike = [r for r in read if r.is_rest == (entry.kind == "rest")]
    if not alike:
        return np.zeros(PHASES.size)
    same = [r for r in alike if r.condition == entry.name]
    nearest = min(same or alike, key=lambda r: abs(math.log(r.period_s / entry.period)))
    history, period = nearest.history, nearest.period_s
    t = np.array(history.t_site_s)
    inlet = np.interp(t, history.t_s, history.P_aorta_mmHg)
    late = t > t[-1] - period * (1.0 - 1e-9)
    difference = np.array(history.P_site_mmHg) - inlet
    return np.interp(PHASES * period, t[late] % period, difference[late], period=period)
