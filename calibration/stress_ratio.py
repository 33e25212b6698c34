"""FFR of a surrogate whose α is tuned to the resting ratio, as a function of all its numbers.

With it any number of the patient can be uncertain (`calibration.uncertainty`): α follows each of
them, so that what calibration takes back is taken back.

What stress does to the patient has three parts: pressures and period; the bed, whose resistances
fall to a share f of those at rest; and the artery, whose losses R0 and K a narrowing of its slit
multiplies. The flow reserve follows from the means, since no capacitance has a net flow::

    Q̄_stress/Q̄_rest = (FFR P̄_stress − P_venous)/(f (r P̄_rest − P_venous))

with the resting ratio r. It is what a flow wire, thermodilution or perfusion imaging measures.

With the form factor of the flow's waveform, β = mean(Q|Q|)/Q̄², which is 1 in steady flow, means
alone give FFR. At rest and under stress, s being the factor of the losses,

    (1 − r) P̄_rest = R0 Q̄ + K β_rest Q̄²,     α R_total = (r P̄_rest − P_venous)/Q̄
    P̄_stress − P_venous = (s R0 + f α R_total) Q̄ + s K β_stress Q̄²

β changes with the numbers of a patient, most with the bed under stress. With β at the medians of
what is uncertain FFR is met within 0.01 to 0.02 (standard deviation) without a periodic state, and
`calibration.two_levels` learns the rest.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.alpha import calibrate_alpha, mean_aortic_pressure, steady_flow, with_alpha
from calibration.sensitivity import STRESS_PREFIX
from calibration.uncertain_names import BED_FACTOR, DILATION, REST_PREFIX, STRESS_LOSS
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

QUICK = Shooting(32, order=3)
"""How cycles are marched where a ratio is wanted many times: FFR of a patient with quadratic loss
moves by 4e-5 from what 256 steps of order 5 give, in a fourteenth of the time."""

_BED = ("R_1", "R_2", "R_3")
_COMMON = (DILATION, BED_FACTOR)
_CONDITION = ("P_systolic", "P_diastolic", "period")
_SURROGATE = ("R0", "K", "C0")


class FormFactors(NamedTuple):
    """mean(Q|Q|)/Q̄² of a patient's flow [-].

    Attributes:
        rest: at rest.
        stress: under stress.
    """

    rest: Float[Array, ""]
    stress: Float[Array, ""]


class StressRatio(eqx.Module):
    """A patient in 0D, from the measured resting ratio to FFR under stress.

    Attributes:
        surrogate: the patient; its own α is not used.
        rest: the resting condition.
        stress: the condition under stress.
        rule: what stress does to the bed.
        rest_ratio: measured resting pressure ratio [-].
        solver: how a cycle of a surrogate with quadratic loss is marched.
        stress_loss: factor of R0 and K under stress [-].
    """

    surrogate: Surrogate
    rest: HaemodynamicCondition
    stress: HaemodynamicCondition
    rule: StressRule
    rest_ratio: Parameter = parameter()
    solver: Shooting = QUICK
    stress_loss: Parameter = parameter(default=1.0)

    def __call__(self) -> Float[Array, ""]:
        """FFR with α tuned [-]; NaN where α or the periodic state is not found."""
        return self._solved[1]

    @property
    def _solved(self) -> tuple[Array, Array]:
        """The tuned α, and FFR with it [-]."""
        fit = calibrate_alpha(
            self.surrogate, self.rest, self.rest_ratio, solver=self.solver, throw=False
        )
        tuned = fit.result == RESULTS.successful
        network = self._stressed.network(self.stress, rule=self.rule)
        network = with_alpha(network, jnp.where(tuned, fit.alpha, 1.0))
        ratio, found = _ratio(network, self.stress.period, self.solver)
        return fit.alpha, jnp.where(found & tuned, ratio, jnp.nan)

    def ffr(self, values: Mapping[str, Parameter]) -> Float[Array, ""]:
        """FFR with other numbers, see `with_values` [-]."""
        return self.with_values(values)()

    @property
    def form_factors(self) -> FormFactors:
        """Of the patient's own flow, from its periodic states; 1 without quadratic loss."""
        artery, K = self.surrogate, self.surrogate.K
        if K is None:
            return FormFactors(jnp.ones(()), jnp.ones(()))
        alpha, ffr = self._solved
        P_rest, P_stress = self._mean_pressures
        R, scale = alpha * artery.coronary.R_total, self.stress_loss

        quadratic = jnp.asarray(K) > 0.0

        def factor(ratio: Parameter, P: Array, R: Array, scale: Parameter) -> Array:
            Q = (ratio * P - artery.coronary.P_venous) / R
            loss = jnp.where(quadratic, K * Q**2, 1.0)
            return jnp.where(quadratic, ((1.0 - ratio) * P / scale - artery.R0 * Q) / loss, 1.0)

        return FormFactors(
            factor(self.rest_ratio, P_rest, R, jnp.ones(())),
            factor(ffr, P_stress, R * self.bed_factor, scale),
        )

    def ffr_of_means(self, values: Mapping[str, Parameter], form: FormFactors) -> Float[Array, ""]:
        """FFR with other numbers and given form factors, in closed form; NaN where there is no α.

        Args:
            values: see `with_values`.
            form: such as the `form_factors` of the patient with the numbers as they are.
        """
        return self.with_values(values)._of_means(form)

    def _of_means(self, form: FormFactors) -> Float[Array, ""]:
        artery, r = self.surrogate, self.rest_ratio
        P_venous = artery.coronary.P_venous
        P_rest, P_stress = self._mean_pressures
        K = jnp.zeros(()) if artery.K is None else artery.K
        Q_rest = steady_flow(artery.R0, K * form.rest, (1.0 - r) * P_rest)
        R = self.bed_factor * (r * P_rest - P_venous) / Q_rest
        s = self.stress_loss
        Q = steady_flow(s * artery.R0 + R, s * K * form.stress, P_stress - P_venous)
        reachable = (r > 0.0) & (r < 1.0) & (r * P_rest > P_venous)
        return jnp.where(reachable, (P_venous + R * Q) / P_stress, jnp.nan)

    @property
    def _mean_pressures(self) -> tuple[Array, Array]:
        """Mean aortic pressure at rest and under stress [dyn/cm²]."""
        rest, stress = (
            mean_aortic_pressure(self.surrogate, one) for one in (self.rest, self.stress)
        )
        return rest, stress

    def reserve(self, values: Mapping[str, Parameter], ffr: Parameter) -> Float[Array, ""]:
        """Flow reserve with other numbers and the FFR that they give [-]."""
        return self.with_values(values).flow_reserve(ffr)

    def flow_reserve(self, ffr: Parameter | None = None) -> Float[Array, ""]:
        """Mean flow under stress over that at rest [-]; NaN where FFR is.

        Args:
            ffr: FFR where it is known already.
        """
        ffr = self() if ffr is None else ffr
        P_venous = self.surrogate.coronary.P_venous
        P_rest, P_stress = self._mean_pressures
        gradient = ffr * P_stress - P_venous
        return gradient / (self.bed_factor * (self.rest_ratio * P_rest - P_venous))

    @property
    def bed_factor(self) -> Float[Array, ""]:
        """Resistance of the whole bed under stress over that at rest [-]."""
        bed = self.surrogate.coronary
        under_stress = sum(getattr(self.rule, part) * getattr(bed, part) for part in _BED)
        return jnp.asarray(under_stress / bed.R_total)

    @property
    def _stressed(self) -> Surrogate:
        """The surrogate with the losses of the artery under stress."""
        artery = self.surrogate
        scaled = eqx.tree_at(lambda s: s.R0, artery, artery.R0 * self.stress_loss)
        if artery.K is None:
            return scaled
        return eqx.tree_at(lambda s: s.K, scaled, artery.K * self.stress_loss)

    def with_values(self, values: Mapping[str, Parameter]) -> "StressRatio":
        """The patient with other numbers.

        Args:
            values: by the names of `values`, those of `ratio_response` and `through_calibration`.

        Raises:
            KeyError: there is no such number.
        """
        places, moved = self._places(), self
        for name in values:
            if name not in places and name not in _COMMON:
                known = ", ".join((*places, *_COMMON))
                raise KeyError(f"a patient has no number {name!r}; take one of {known}")
            if name not in _COMMON:
                moved = eqx.tree_at(places[name], moved, jnp.asarray(values[name], float))
        moved = dataclasses.replace(
            moved, rest=_moved(self.rest, moved.rest), stress=_moved(self.stress, moved.stress)
        )
        # last: they multiply the factors of the rule, given or not
        common = values.get(DILATION, 1.0)
        if BED_FACTOR in values:
            common = common * values[BED_FACTOR] / moved.bed_factor
        for part in _BED:
            place = places[f"{STRESS_PREFIX}{part}"]
            moved = eqx.tree_at(place, moved, replace_fn=lambda R: common * R)
        return moved

    @property
    def values(self) -> dict[str, Array]:
        """All numbers by name; `dilation` is 1."""
        found = {name: place(self) for name, place in self._places().items()}
        return {**found, DILATION: jnp.ones(()), BED_FACTOR: self.bed_factor}

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
        places[STRESS_LOSS] = lambda m: m.stress_loss
        return {**places, "rest_ratio": lambda m: m.rest_ratio}


def _moved(before: HaemodynamicCondition, after: HaemodynamicCondition) -> HaemodynamicCondition:
    """The condition after a change of its numbers, whose measured beat goes along."""
    return before.moved(**{name: getattr(after, name) for name in _CONDITION})


def _ratio(network: Network, period: Parameter, solver: Shooting) -> tuple[Array, Array]:
    """Mean distal over mean aortic pressure, and whether the periodic state was found."""
    if network.is_linear:
        mean = mean_state(network, period)
        distal, aorta = network.pressure_index("distal"), network.pressure_index("aorta")
        return mean[distal] / mean[aorta], jnp.ones((), bool)
    solution = solve_periodic(network, period, solver, throw=False)
    return pressure_ratio(solution), solution.result == RESULTS.successful
