"""Changes of a block's parameters from rest to pharmacological stress.

The method paper's equations halve R_2 and R_s and double C_a, C_im and C_s ("printed"); its prose
says that all resistances halve ("all"). Printed lowers the nominal coronary total by 8.8 %, "all"
by 50 %: studies report both.
"""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.network import Network
from lumped.parameters import Parameter, Range, check_range, parameter


class StressRule(eqx.Module):
    """Factors that multiply the parameters of a boundary block under stress.

    Coronary blocks use R_1, R_2, R_3, C_a, C_im; Windkessel blocks use R_proximal, R_distal, C.
    All factors are differentiated. The defaults are those of the rule "printed", not 1; in a case
    file a factor that is left out of [stress.factors] is 1.

    Source: Puelz et al. 2024, section 2.3.
    """

    ranges: ClassVar[Range] = Range(
        above=("R_1", "R_2", "R_3", "C_a", "C_im", "R_proximal", "R_distal", "C")
    )
    R_1: Parameter = parameter(default=1.0)
    R_2: Parameter = parameter(default=0.5)
    R_3: Parameter = parameter(default=1.0)
    C_a: Parameter = parameter(default=2.0)
    C_im: Parameter = parameter(default=2.0)
    R_proximal: Parameter = parameter(default=1.0)
    R_distal: Parameter = parameter(default=0.5)
    C: Parameter = parameter(default=2.0)

    def __check_init__(self):
        check_range(self)

    def __call__(self, block: Any) -> Any:
        """The block under stress: each parameter that has a factor here is multiplied by it."""
        return scaled(
            block,
            **{
                field.name: getattr(self, field.name)
                for field in dataclasses.fields(self)
                if hasattr(block, field.name)
            },
        )


PRINTED = "printed"
ALL = "all"


def stress_rule(name: str) -> StressRule:
    """The rule of that name: "printed" (equations of the paper) or "all" (its prose).

    Raises:
        ValueError: no such rule.
    """
    if name == PRINTED:
        return StressRule()
    if name == ALL:
        return StressRule(R_1=0.5, R_3=0.5, R_proximal=0.5)
    raise ValueError(
        f"Stress rule '{name}' is not known. Use 'printed', 'all', or factors: StressRule(...)."
    )


def scaled(block: Any, **factors: Parameter) -> Any:
    """A copy of a block with the named parameters multiplied by factors.

    Raises:
        ValueError: a concrete parameter leaves its range, as by a factor that is not positive.
    """
    names = tuple(factors)
    values = tuple(getattr(block, name) * factors[name] for name in names)
    found = eqx.tree_at(lambda b: tuple(getattr(b, name) for name in names), block, values)
    check_range(found)
    return found


def scale_resistances(block: Any, alpha: Parameter) -> Any:
    """Multiply R_1, R_2 and R_3 of a coronary block by the patient's scale factor α."""
    return scaled(block, R_1=alpha, R_2=alpha, R_3=alpha)


def transition(
    x: Float[Array, " n"], rest: Network, stress: Network, *, hold: str = "pressure"
) -> Float[Array, " n"]:
    """States of the stressed network that continue states of the resting one, at a cycle's start.

    Args:
        x: states of `rest` at the end of a cycle.
        rest: the network before.
        stress: the network after; same elements, other parameters.
        hold: what stays continuous: "pressure" of every compliance (flows of inertances too), or
            "volume", i.e. compliance times transmural pressure (momentum L Q for inertances).

    Raises:
        ValueError: `hold` is neither, or the networks differ in structure.
    """
    states = [[e.state_names for e in network.elements] for network in (rest, stress)]
    if rest.names != stress.names or states[0] != states[1]:
        raise ValueError("The two networks must have the same elements and states.")
    if hold == "pressure":
        start = jnp.zeros(())
        return x + rest.external_pressure(start) - stress.external_pressure(start)
    if hold == "volume":
        return x * rest.mass() / stress.mass()
    raise ValueError(f"hold = '{hold}' is not known. Use 'pressure' or 'volume'.")
