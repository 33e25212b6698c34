"""The periodic state of a network: one vocabulary for all ways to find it.

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

from lumped.network import Network
from lumped.parameters import Parameter
from lumped.periodic_linear import Propagator
from lumped.periodic_nonlinear import Shooting
from lumped.periodic_solution import (
    AbstractPeriodicSolver,
    PeriodicSolution,
    raise_unless_successful,
)


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
        solver: one of the solvers above; by default `Propagator` for linear networks and
            `Shooting` for others.
        throw: raise when the solver fails (outside jit). With False look at `result`.

    Returns:
        The periodic state with its error estimate and Floquet multiplier.

    Raises:
        ValueError: the solver does not fit the network.
        RuntimeError: the solver did not converge.
    """
    if solver is None:
        solver = Propagator() if network.is_linear else Shooting()
    solution = solver(network, period)
    if throw:
        raise_unless_successful(
            solution.result,
            "Use more steps a cycle, start with a smaller quadratic loss, or try the solver "
            "`Cycles`, which only runs the model forward.",
        )
    return solution
