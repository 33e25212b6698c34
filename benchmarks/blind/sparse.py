"""Baseline: sparse regression of the base model's residual on the traces of all effects.

Sequentially thresholded least squares: all effects at once, those below `THRESHOLD` noise units are
left out, and again until none is. Source: Brunton, Proctor & Kutz 2016 (PNAS 113:3932).
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from diagnosis import Diagnosis, Effect
from diagnosis.hypothesis import numbers_of
from diagnosis.measured import Measured
from diagnosis.scan import linearise
from lumped.elimination import solve_definite

THRESHOLD = 2.0
"""Length of an effect's own trace below which it is left out [noise sd]."""


@partial(jax.jit, static_argnames=("effects",))
def _projected(record: Measured, x: Array, effects: tuple[Effect, ...]) -> tuple[Array, Array]:
    """Inner products of the effects' own traces with each other and with the residual."""
    zero = jnp.zeros(len(effects))
    (e, J), G = linearise(record, effects, numbers_of(effects), x, zero)
    precision = jnp.eye(J.shape[-1]) + jnp.einsum("cdk,cdl->kl", J, J)
    JG = jnp.einsum("cdk,cde->ke", J, G)
    solved = solve_definite(precision, JG)
    along = jnp.einsum("cde,cd->e", G, e) - solved.T @ jnp.einsum("cdk,cd->k", J, e)
    return jnp.einsum("cde,cdf->ef", G, G) - JG.T @ solved, along


def strongest_term(diagnosis: Diagnosis) -> str:
    """The effect with the largest term that is left, or "none"."""
    x = jnp.asarray(np.asarray(diagnosis.base.x))
    inner, along = map(np.asarray, _projected(diagnosis.record, x, diagnosis.effects))
    length = np.sqrt(np.maximum(np.diag(inner), 0.0))
    kept = np.flatnonzero(length > 0.0)
    while kept.size:
        ridge = inner[np.ix_(kept, kept)] + np.eye(kept.size)
        size = np.linalg.solve(ridge, along[kept])
        strength = np.abs(size) * length[kept]
        if strength.min() >= THRESHOLD:
            return diagnosis.effects[int(kept[np.argmax(strength)])].id
        kept = kept[strength >= THRESHOLD]
    return "none"
