"""Damping of a least-squares fit, adapted after each step by Nielsen's rule.

With ϱ the gain of a step over the gain that the linear model promised, a step that is taken
multiplies the damping by clip(1 − (2ϱ − 1)³, 1/10, 2); one that is refused multiplies it by 2, the
next one by 4, and so on.

Source: Madsen, Nielsen & Tingleff 2004, Methods for Non-Linear Least Squares Problems, eq. 2.21.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

FIRST_GROWTH = 2.0
"""Factor of the first step that is refused."""


def next_damping(
    damping: Float[Array, ""],
    growth: Float[Array, ""],
    taken: Bool[Array, ""],
    ratio: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Damping of the next step, and its growth if that step is rejected.

    Args:
        damping: of the step that was tried.
        growth: factor by which it grows where the step is refused.
        taken: whether the step was taken.
        ratio: gain over the promised gain ϱ [-].
    """
    shrink = jnp.clip(1.0 - (2.0 * ratio - 1.0) ** 3, 0.1, 2.0)
    factor = jnp.where(taken, shrink, growth)
    return damping * factor, jnp.where(taken, FIRST_GROWTH, FIRST_GROWTH * growth)
