"""The R0 run: a ramp of the pressure drop over the anomalous artery in 3D.

The wall is prestressed at a low pressure. From there the pressure rises at a constant rate at all
openings but that of the anomalous artery, where it stays: all flow passes the artery, and none the
aorta. What it gives is fitted by `calibration.ramp`.

Source: Puelz et al. 2024, section 2.4: 60 mmHg, 37.5 mmHg/s, slope at 40 mmHg.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from calibration import RampRecord
from jaxfsi.core.step.state import initial_state
from jaxfsi.opening import INLET, canonical_order, is_anomalous
from jaxfsi.simulation import StepHistory
from jaxfsi.simulation.record import port_flow, port_pressure
from lumped import Ramp
from study.run.case_model import case_model
from study.run.run_3d import finished_run
from study.run.run_context import RunContext
from study.run.setup import STEP, aortic_pressure, outlet_blocks
from study.run.shared_step import ramped
from study.run.simulation_data import Outlets, Schedule, Setup
from study.run.study_choice import RampChoice
from study.store.result_names import RAMP
from study.store.stages import stage_key

_FRAMES = 4


def ramp_record(
    context: RunContext,
    choice: RampChoice,
    prepared: Callable[[RunContext], object] | None = None,
) -> RampRecord:
    """Run the ramp, or take what was kept of it.

    Args:
        context: see `RunContext`.
        choice: how it is made.
        prepared: called before its first step.

    Raises:
        RuntimeError: a step failed.
    """
    key = ramp_key(context, choice)

    def compute() -> dict[str, np.ndarray]:
        setup = prepare_ramp(context, choice)
        if prepared is not None:
            prepared(context)
        record = finished_run(context, RAMP, key, setup).record
        return _columns(record, setup.model.names)

    found = context.stages.arrays(RAMP, stage_key("reading", key), compute)
    return RampRecord(**found)


def ramp_key(context: RunContext, choice: RampChoice) -> str:
    """Hash of all that the ramp follows from."""
    case, dt = context.case, context.choice.dt
    solver = dataclasses.replace(case.solver, n_steps=None, cycles=None)
    return stage_key(RAMP, context.mesh_key, case.blood, case.wall, solver, dt, choice)


def ramp_plan(context: RunContext, choice: RampChoice) -> Schedule:
    """Steps and frames of the ramp."""
    dt = context.choice.dt or context.case.solver.dt or STEP
    duration = choice.drop / choice.rate
    n_steps = max(20, math.ceil(duration / dt - 1e-9))
    n_steps = math.ceil(n_steps / _FRAMES) * _FRAMES
    return Schedule(duration / n_steps, n_steps, n_steps, n_steps // _FRAMES, duration)


def prepare_ramp(context: RunContext, choice: RampChoice) -> Setup:
    """Model and start of the ramp."""
    case, mesh = context.case, context.mesh
    plan = ramp_plan(context, choice)
    rising, held = Ramp(choice.P_image, choice.rate), Ramp(choice.P_image, 0.0)
    pressures = {name: held if is_anomalous(name) else rising for name in mesh.openings}
    at_rest = Outlets(1.0, "none", outlet_blocks(case, "rest", mesh, 1.0, None), {})
    own = at_rest.ports(aortic_pressure(case.conditions["rest"]), mesh.openings)
    ports = ramped(own, pressures)
    model = case_model(case, mesh, ports, choice.P_image, keep=context.keep)
    state = initial_state(model, p=choice.P_image)
    return Setup(mesh, model, state, rising, Outlets(1.0, "none", {}, {}), plan)


def _columns(record: StepHistory, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    distal = [name for name in canonical_order(names) if is_anomalous(name)]
    return {
        "t": record.t,
        "P_aorta": port_pressure(record, names, INLET),
        "P_distal": port_pressure(record, names, distal[0]),
        "Q": np.sum([port_flow(record, names, n) for n in distal], axis=0),
    }
