"""FFR of a surrogate whose α is tuned to the resting ratio, as a function of all its numbers.

With it any number of the patient can be uncertain (`calibration.uncertainty`): α follows each of
them, so that what calibration takes back is taken back.
"""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.alpha import calibrate_alpha, with_alpha
from calibration.sensitivity import STRESS_PREFIX
from lumped import (
    RESULTS,
    HaemodynamicCondition,
    Network,
    Shooting,
    StressRule,
    Surrogate,
    mean_state,
    pressure_ratio,
    solve_periodic,
)
from lumped.nominal import NOMINAL
from lumped.parameters import Parameter, parameter

REST_PREFIX = "rest_"
"""Begins the name of a pressure or period at rest, `rest_period`."""

DILATION = "dilation"
"""Common factor of the resistances of the bed under stress, times those of the rule."""

QUICK = Shooting(32, order=3)
"""How cycles are marched where a ratio is wanted many times: FFR of a patient with quadratic loss
moves by 4e-5 from what 256 steps of order 5 give, in a fourteenth of the time."""

_BED = ("R_1", "R_2", "R_3")
_CONDITION = ("P_systolic", "P_diastolic", "period")
_SURROGATE = ("R0", "K", "C0")


class StressRatio(eqx.Module):
    """A patient in 0D, from the measured resting ratio to FFR under stress.

    Attributes:
        surrogate: the patient; its own α is not used.
        rest: the resting condition.
        stress: the condition under stress.
        rule: what stress does to the bed.
        rest_ratio: measured resting pressure ratio [-].
        solver: how a cycle of a surrogate with quadratic loss is marched.
    """

    surrogate: Surrogate
    rest: HaemodynamicCondition
    stress: HaemodynamicCondition
    rule: StressRule
    rest_ratio: Parameter = parameter()
    solver: Shooting = QUICK

    def __call__(self) -> Float[Array, ""]:
        """FFR with α tuned [-]; NaN where α or the periodic state is not found."""
        fit = calibrate_alpha(
            self.surrogate, self.rest, self.rest_ratio, solver=self.solver, throw=False
        )
        tuned = fit.result == RESULTS.successful
        network = self.surrogate.network(self.stress, rule=self.rule)
        network = with_alpha(network, jnp.where(tuned, fit.alpha, 1.0))
        ratio, found = _ratio(network, self.stress.period, self.solver)
        return jnp.where(found & tuned, ratio, jnp.nan)

    def with_values(self, values: Mapping[str, Parameter]) -> "StressRatio":
        """The patient with other numbers.

        Args:
            values: by the names of `values`, those of `ratio_response` and `through_calibration`.

        Raises:
            KeyError: there is no such number.
        """
        places, moved = self._places(), self
        for name in values:
            if name not in places and name != DILATION:
                known = ", ".join((*places, DILATION))
                raise KeyError(f"a patient has no number {name!r}; take one of {known}")
            if name != DILATION:
                moved = eqx.tree_at(places[name], moved, jnp.asarray(values[name], float))
        # last: it multiplies the factors of the rule, given or not
        wider = {f"{STRESS_PREFIX}{part}": values.get(DILATION, 1.0) for part in _BED}
        for name, factor in wider.items():
            moved = eqx.tree_at(places[name], moved, replace_fn=lambda R, c=factor: c * R)
        return moved

    @property
    def values(self) -> dict[str, Array]:
        """All numbers by name; `dilation` is 1."""
        found = {name: place(self) for name, place in self._places().items()}
        return {**found, DILATION: jnp.ones(())}

    def _places(self) -> dict[str, Callable[[Any], Any]]:
        def of(part: str, name: str) -> Callable[[Any], Any]:
            return lambda m: getattr(getattr(m, part), name)

        places = {
            name: of("surrogate", name)
            for name in _SURROGATE
            if getattr(self.surrogate, name) is not None
        }
        for name in (*NOMINAL, "P_venous", "im_factor"):
            places[name] = lambda m, name=name: getattr(m.surrogate.coronary, name)
        places |= {name: of("stress", name) for name in _CONDITION}
        places |= {f"{REST_PREFIX}{name}": of("rest", name) for name in _CONDITION}
        places |= {f"{STRESS_PREFIX}{name}": of("rule", name) for name in NOMINAL}
        return {**places, "rest_ratio": lambda m: m.rest_ratio}


def _ratio(network: Network, period: Parameter, solver: Shooting) -> tuple[Array, Array]:
    """Mean distal over mean aortic pressure, and whether the periodic state was found."""
    if network.is_linear:
        mean = mean_state(network, period)
        distal, aorta = network.pressure_index("distal"), network.pressure_index("aorta")
        return mean[distal] / mean[aorta], jnp.ones((), bool)
    solution = solve_periodic(network, period, solver, throw=False)
    return pressure_ratio(solution), solution.result == RESULTS.successful
