"""The R0 run: a ramp of the pressure drop over the anomalous artery in 3D.

The wall is prestressed at a low pressure. From there the pressure rises at a constant rate at all
openings but that of the anomalous artery, where it stays: all flow passes the artery, and none the
aorta. What it gives is fitted by `calibration.ramp`.

Source: Puelz et al. 2024, section 2.4: 60 mmHg, 37.5 mmHg/s, slope at 40 mmHg.
"""

import dataclasses
import math

import numpy as np

from calibration import RampFit, RampRecord, fit_ramp, measured_slope
from jaxfsi.core.ports.port import AbstractPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.state import initial_state
from jaxfsi.opening import INLET, canonical_order, is_anomalous
from jaxfsi.simulation import Record
from jaxfsi.simulation.record import port_flow, port_pressure
from lumped import MMHG, Ramp
from lumped.waveforms import Constant
from study.run.case_model import case_model
from study.run.run_3d import RunContext, finished_run
from study.run.setup import STEP, Outlets, Schedule, Setup
from study.store.stages import stage_key

RAMP = "ramp"
_FRAMES = 4


@dataclasses.dataclass(frozen=True)
class RampChoice:
    """How the ramp is made; the paper's numbers.

    Attributes:
        P_image: pressure at which the wall is prestressed and the ramp starts [dyn/cm²].
        rate: of the drop [dyn/(cm²·s)].
        drop: largest drop [dyn/cm²].
    """

    P_image: float = 60.0 * MMHG
    rate: float = 37.5 * MMHG
    drop: float = 42.0 * MMHG


def ramp_record(context: RunContext, choice: RampChoice) -> RampRecord:
    """Run the ramp, or take what was kept of it.

    Raises:
        RuntimeError: a step failed.
    """
    case = context.case
    solver = dataclasses.replace(case.solver, n_steps=None, cycles=None)
    dt = context.choice.dt
    key = stage_key(RAMP, context.mesh_key, case.blood, case.wall, solver, dt, choice)

    def compute() -> dict[str, np.ndarray]:
        setup = prepare_ramp(context, choice)
        record = finished_run(context, RAMP, key, setup).record
        return _columns(record, setup.model.names)

    found = context.stages.arrays(RAMP, stage_key("reading", key), compute)
    return RampRecord(**found)


def prepare_ramp(context: RunContext, choice: RampChoice) -> Setup:
    """Model and start of the ramp."""
    case, mesh = context.case, context.mesh
    duration = choice.drop / choice.rate
    n_steps = max(20, math.ceil(duration / (context.choice.dt or case.solver.dt or STEP) - 1e-9))
    n_steps = math.ceil(n_steps / _FRAMES) * _FRAMES
    plan = Schedule(duration / n_steps, n_steps, n_steps, n_steps // _FRAMES, duration)
    rising, held = Ramp(choice.P_image, choice.rate), Constant(choice.P_image)
    ports: dict[str, AbstractPort] = {
        name: PressurePort(held if is_anomalous(name) else rising) for name in mesh.openings
    }
    model = case_model(case, mesh, ports, choice.P_image, keep=context.keep)
    state = initial_state(model, p=choice.P_image)
    return Setup(mesh, model, state, rising, Outlets(1.0, "none", {}, {}), plan)


def _columns(record: Record, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    distal = [name for name in canonical_order(names) if is_anomalous(name)]
    return {
        "t": record.t,
        "P_aorta": port_pressure(record, names, INLET),
        "P_distal": port_pressure(record, names, distal[0]),
        "Q": np.sum([port_flow(record, names, n) for n in distal], axis=0),
    }


@dataclasses.dataclass(frozen=True)
class Secant:
    """Resistance at a pressure drop.

    Attributes:
        secant: drop over flow [dyn·s/cm⁵].
        sd: its standard deviation [dyn·s/cm⁵].
    """

    secant: float
    sd: float


@dataclasses.dataclass(frozen=True)
class RampPart:
    """The ramp as documents hold it; the curve is ΔP = a Q + b Q|Q| + L dQ/dt.

    Attributes:
        P_image_mmHg: pressure at which the ramp starts.
        rate_mmHg_per_s: rate of the drop.
        largest_drop_mmHg: largest drop.
        a: of the curve [dyn·s/cm⁵].
        a_sd: its standard deviation.
        b: of the curve [dyn·s²/cm⁸].
        b_sd: its standard deviation.
        inertance: L of the curve [dyn·s²/cm⁵].
        rms_mmHg: root mean square of what the curve misses.
        n_effective: number of independent samples.
        tangent_40_mmHg: slope of the curve at 40 mmHg [dyn·s/cm⁵].
        tangent_40_mmHg_sd: its standard deviation.
        measured_slope_40_mmHg: slope of the ramp itself there [dyn·s/cm⁵].
        secants_by_drop_mmHg: resistance at some drops.
        Q_cm3_per_s: flow of some samples.
        drop_mmHg: drop of these.
    """

    P_image_mmHg: float
    rate_mmHg_per_s: float
    largest_drop_mmHg: float
    a: float
    a_sd: float
    b: float
    b_sd: float
    inertance: float
    rms_mmHg: float
    n_effective: float
    tangent_40_mmHg: float
    tangent_40_mmHg_sd: float
    measured_slope_40_mmHg: float | None
    secants_by_drop_mmHg: dict[str, Secant]
    Q_cm3_per_s: list[float]
    drop_mmHg: list[float]


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
            a=float(fit.law.a),
            a_sd=float(np.sqrt(fit.covariance[0, 0])),
            b=float(fit.law.b),
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
