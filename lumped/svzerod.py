"""A svZeroDSolver case: a network with the settings of its run, simulated as svZeroDSolver does.

Read cases with `read_svzerod`, write them with `write_svzerod`. `simulate_case` gives what
svZeroDSolver's run gives, a transient from a steady start, but integrated by Radau steps that end
at every sample of the sources; `periodic_case` gives what such a run is meant to approach.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lumped.march import Trajectory, march
from lumped.network import Network, jacobian
from lumped.periodic_linear import Propagator
from lumped.periodic_nonlinear import Shooting
from lumped.periodic_solution import (
    AbstractPeriodicSolver,
    PeriodicSolution,
)
from lumped.results import raise_unless_successful
from lumped.statespace import is_index_one, is_regular
from lumped.svzerod_series import merged, steady_sources
from lumped.vessels import Vessel, VesselCRL

SAMPLES = 1000
"""Equal parts into which the period of a smooth waveform is cut to make a time series."""

STEP_DEFECT = 1e-8
"""Newton correction of a step, relative to the unknowns, above which a run counts as failed."""

Table = dict[str, np.ndarray]
"""Columns of a result: name, time, flow_in, flow_out, pressure_in, pressure_out."""


@dataclasses.dataclass(frozen=True)
class SvZeroDOutput:
    """Form of the output of a case.

    Attributes:
        all_cycles: every cycle, or the last one only with its time starting at 0.
        interval: every how many time points.
        mean_only: only the mean over the reported points.
        by_variable: one row a variable instead of one a vessel.
        derivatives: time derivatives as well.
    """

    all_cycles: bool = False
    interval: int = 1
    mean_only: bool = False
    by_variable: bool = False
    derivatives: bool = False


@dataclasses.dataclass(frozen=True)
class SvZeroDCase:
    """A network and the settings of its run; svZeroDSolver has no units, files are taken as CGS.

    Attributes:
        network: the network; its sources repeat after `period`.
        period: length of the cycle [s].
        cycles: cycles to run.
        points_per_cycle: time points of a cycle, both ends counted.
        steady_initial: start from the steady state under the mean of the sources; else from 0.
        cycle_error: relative cycle-to-cycle error until which svZeroDSolver would run, or None.
        output: what is reported.
        vessels: names of the vessels that are reported, None for all.
        name: name of the case.
    """

    network: Network
    period: float
    cycles: int = 10
    points_per_cycle: int = 201
    steady_initial: bool = True
    cycle_error: float | None = None
    output: SvZeroDOutput = SvZeroDOutput()
    vessels: tuple[str, ...] | None = None
    name: str = "case"

    def __post_init__(self):
        """Refuse settings without meaning."""
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise ValueError(f"The period {self.period} s must be positive. Check its unit.")
        if self.cycles < 1 or self.points_per_cycle < 2 or self.output.interval < 1:
            raise ValueError(
                f"A run needs at least 1 cycle, 2 points a cycle and interval 1; got {self.cycles},"
                f" {self.points_per_cycle} and {self.output.interval}. Raise the number."
            )

    @property
    def reported(self) -> tuple[str, ...]:
        """Names of the vessels that are reported."""
        if self.vessels is not None:
            return self.vessels
        pairs = zip(self.network.names, self.network.elements, strict=True)
        return tuple(name for name, element in pairs if isinstance(element, Vessel | VesselCRL))


def simulate_case(case: SvZeroDCase, *, order: int = 5) -> Table:
    """Run a case as svZeroDSolver does, from its initial state through its cycles.

    Steps end at the time points of the case and at every breakpoint of its sources. The first
    point is the initial state itself: under the mean of the sources, as svZeroDSolver reports it.

    Args:
        case: the case.
        order: order of the Radau steps: 1, 3 or 5.

    Returns:
        Columns as svZeroDSolver names them, vessel after vessel; `pandas.DataFrame` takes them.

    Raises:
        ValueError: the case asks for another form of output or for a run of unknown length, or
            there is no steady state to start from.
        RuntimeError: a step could not be solved.
    """
    _refuse_other_forms(case)
    network = case.network
    z = steady_unknowns(case) if case.steady_initial else jnp.zeros(network.n_unknowns)
    ts, rows = _step_ends(case)
    points = [np.asarray(z)[None]]
    for _ in range(case.cycles):
        path = _march(ts, network, z, order)
        z = path.z[-1]
        if not (np.isfinite(float(path.defect)) and float(path.defect) < STEP_DEFECT):
            raise RuntimeError(
                f"A step of {case.name} could not be solved (defect {float(path.defect):.1e}). "
                "Use more points a cycle or a smaller quadratic loss."
            )
        cycle = np.asarray(path.z)[rows[1:]]
        points = [*points, cycle] if case.output.all_cycles else [points[-1][-1:], cycle]
    unknowns = np.concatenate(points)
    t = np.arange(unknowns.shape[0]) * (case.period / (case.points_per_cycle - 1))
    step = case.output.interval
    return _table(case, t[::step], unknowns[::step])


def periodic_case(
    case: SvZeroDCase, solver: AbstractPeriodicSolver | None = None
) -> PeriodicSolution:
    """The periodic state of a case, which a run of many cycles approaches.

    Args:
        case: the case.
        solver: how to find it; by default `Propagator`, or `Shooting` for networks that are
            nonlinear, have no state, or are not of index 1 (a compliance directly on a pressure
            source).
    """
    if solver is None:
        network = case.network
        direct = network.is_linear and network.n_states > 0 and is_index_one(network)
        solver = Propagator() if direct else Shooting()
    solution = _periodic(case.network, case.period, solver)
    raise_unless_successful(
        solution.result, "Use more steps a cycle, a smaller quadratic loss, or `Cycles`."
    )
    return solution


@eqx.filter_jit
def _periodic(network: Network, period: float, solver: AbstractPeriodicSolver) -> PeriodicSolution:
    return solver(network, period)


def steady_unknowns(case: SvZeroDCase) -> Float[Array, " m"]:
    """All unknowns at the steady state under the mean of every source's time series.

    Raises:
        ValueError: there is none, or Newton's method does not find it.
    """
    network = steady_sources(case.network, case.period, samples=SAMPLES)
    cure = "Set steady_initial to false, or connect a resistance or a pressure to the network."
    z = jnp.ones(network.n_unknowns)  # the derivative of a quadratic loss vanishes at rest
    for _ in range(100):
        slope = np.asarray(jacobian(network, 0.0, z))
        if not is_regular(slope):
            raise ValueError(f"{case.name} has no unique steady state to start from. {cure}")
        correction = np.linalg.solve(slope, np.asarray(network.residual(0.0, z)))
        z = z - correction
        if np.all(np.abs(correction) <= 1e-12 * np.maximum(np.abs(np.asarray(z)), 1e-6)):
            return z
        if network.is_linear:
            return z
    raise ValueError(f"No steady state of {case.name} was found in 100 Newton steps. {cure}")


@eqx.filter_jit
def _march(
    ts: Float[Array, " k"], network: Network, z: Float[Array, " m"], order: int
) -> Trajectory:
    return march(ts, network, z, order=order)


def _step_ends(case: SvZeroDCase) -> tuple[Array, np.ndarray]:
    """Step ends of a cycle, and which of them are time points of the case."""
    t = np.linspace(0.0, case.period, case.points_per_cycle)
    ts = merged(t, np.asarray(case.network.breakpoints(case.period)), case.period)
    return jnp.asarray(ts), np.searchsorted(ts, t)


def _table(case: SvZeroDCase, t: np.ndarray, z: np.ndarray) -> Table:
    network = case.network
    keys = ("name", "time", "flow_in", "flow_out", "pressure_in", "pressure_out")
    parts: dict[str, list[np.ndarray]] = {key: [np.zeros(0)] for key in keys}
    for name in case.reported:
        inlet, outlet = network.ports[network.names.index(name)]
        columns = [
            z[:, network.flow_index(name, 0)],
            -z[:, network.flow_index(name, 1)],
            z[:, network.pressure_index(inlet)],
            z[:, network.pressure_index(outlet)],
        ]
        if case.output.mean_only:
            columns = [np.mean(column, keepdims=True) for column in columns]
        time = np.full(1, np.nan) if case.output.mean_only else t
        columns = [np.full(time.size, name, dtype=object), time, *columns]
        for key, column in zip(keys, columns, strict=True):
            parts[key].append(column)
    return {key: np.concatenate(columns) for key, columns in parts.items()}


def _refuse_other_forms(case: SvZeroDCase) -> None:
    if case.output.by_variable or case.output.derivatives:
        raise ValueError(
            f"{case.name} asks for output by variable or with derivatives, but results are tables "
            "of flow and pressure by vessel. Set output_variable_based and output_derivative to "
            "false."
        )
    if case.cycle_error is not None:
        raise ValueError(
            f"{case.name} asks to run until cycles repeat within {case.cycle_error:g}. Use "
            "`periodic_case`, which finds that state itself, or give a number of cycles."
        )
