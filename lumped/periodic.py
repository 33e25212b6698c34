"""The periodic state of a network: one interface to all solvers.

`solve_periodic(network, period, solver)` returns a `PeriodicSolution`. Solvers:

| solver | for | error |
|---|---|---|
| `Fourier` | linear networks, batches | algebraic in the samples where sources have kinks |
| `Propagator` | linear networks, the reference | that of interpolating the sources |
| `Shooting` | any network, also nonlinear | order of its marching scheme |
| `Cycles` | any vector field, by adaptive diffrax until cycles repeat | its tolerances |

Means over a cycle need no waveform where the network is linear: `mean_state` solves the direct-
current network, because no capacitance has a net flow over a cycle and no inertance a net
pressure. Derivatives never run through cycles: periodic states are solutions of equations and are
differentiated as such.
"""

import jax
import numpy as np

from lumped.device import quick_jit
from lumped.network import Network
from lumped.parameters import Parameter, is_traced, real
from lumped.periodic_linear import Propagator
from lumped.periodic_nonlinear import Shooting
from lumped.periodic_solution import (
    AbstractPeriodicSolver,
    PeriodicSolution,
)
from lumped.results import raise_unless_successful
from lumped.statespace import NOT_INDEX_ONE, is_index_one

PERIOD_TOLERANCE = 1e-6
"""Relative tolerance of periods, which admits input in single precision."""


def solve_periodic(
    network: Network,
    period: Parameter,
    solver: AbstractPeriodicSolver | None = None,
    *,
    throw: bool = True,
) -> PeriodicSolution:
    """Find the periodic state of a network.

    Args:
        network: the network; its sources must repeat after `period`.
        period: length of the cycle [s].
        solver: one of the solvers above; by default `Propagator` for linear networks of index 1
            and `Shooting` for others.
        throw: raise when the solver fails (outside jit). With False look at `result`.

    Returns:
        The periodic state with its error estimate and Floquet multiplier.

    Raises:
        ValueError: the solver does not fit the network, or a source does not repeat after the
            period (not checked while tracing).
        RuntimeError: the solver did not converge.
    """
    period = real(period)
    require_period(network, period)
    regular = is_traced(*jax.tree.leaves(network)) or is_index_one(network)
    if solver is None:
        solver = Propagator() if network.is_linear and regular else Shooting()
    if solver.needs_index_one and not regular:
        raise ValueError(NOT_INDEX_ONE.format(", ".join(network.names)))
    solution = _solve(solver, network, period)
    if throw:
        raise_unless_successful(
            solution.result,
            "Is some node cut off from every pressure? Else use more steps a cycle, start with a "
            "smaller quadratic loss, or try `Cycles`, which only runs the model forward.",
        )
    return solution


@quick_jit
def _solve(solver: AbstractPeriodicSolver, network: Network, period: Parameter) -> PeriodicSolution:
    return solver(network, period)


def require_period(network: Network, period: Parameter) -> None:
    """Refuse a period that is not positive and sources that do not repeat after it.

    A smooth source may repeat several times within it; one with breakpoints must have the period
    itself, because breakpoints are marked once a cycle.

    Raises:
        ValueError: the period or a source is refused; not checked while tracing.
    """
    if not is_traced(period) and not np.all(np.isfinite(period) & (np.asarray(period) > 0.0)):
        raise ValueError(f"The period {period} s must be positive. Give the cycle length in s.")
    for waveform in network.waveforms():
        own = waveform.repeats_after()
        if own is None or is_traced(own, period):
            continue
        repeats = np.asarray(period) / np.asarray(own)
        whole = np.maximum(np.round(repeats), 1.0) if waveform.breakpoints().size == 0 else 1.0
        if not np.all(np.abs(repeats - whole) <= PERIOD_TOLERANCE * whole):
            raise ValueError(
                f"{type(waveform).__name__} repeats after {np.asarray(own)} s, the cycle is "
                f"{np.asarray(period)} s. Give source and solver the same period."
            )
