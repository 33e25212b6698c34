"""How well a hypothesis predicts conditions that it was not fitted to.

With the model linearised about a hypothesis's posterior mean, the ln density of the data of a
condition c given the others is the difference of two evidences,

    ln p(y_c | y_others) = ln Z(all) − ln Z(all but c).

The freedom of guessed equations widens what they predict in each condition anew. Where the data
follow an effect's form more closely than that, the freedom alone would make the effect predict
worse than no gap does: the density is that of the kind of equations for which it is largest.

Held-out conditions are revealed here alone, after the fit: ln p(held out | fitted). A named effect
has to predict them no worse than no gap does; without held-out data, every condition is left out in
turn.

Source: leave-one-out predictive densities, Vehtari & Lampinen 2002 (Neural Comput 14:2439).
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from diagnosis.effects import Effect
from diagnosis.evidence import Whitened, log_prior_of_sizes
from diagnosis.form_columns import KINDS, Freedom
from diagnosis.hypothesis import (
    Catalogue,
    by_condition,
    of_kind,
    one_sided_unknowns,
    sensor_model,
    uncertain_signals,
)
from diagnosis.measured import Measured, data_of, whitener_of
from diagnosis.prediction import condition_settings, selection


class Predicted(NamedTuple):
    """Ln predictive densities of a hypothesis, or their gain over those of no gap.

    Attributes:
        held_out: of all held-out conditions given the fitted ones; 0 where there are none.
        left_out: of each fitted condition given the other fitted ones; 0 for held-out ones.
    """

    held_out: Float[Array, "*b"]
    left_out: Float[Array, "*b c"]


def predictive_density(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    *,
    nonlinear: bool,
) -> Predicted:
    """Ln predictive densities of a fitted hypothesis.

    Args:
        measured: the record.
        effects: the catalogue (static).
        numbers: of the catalogue.
        pair: positions of the hypothesis's effects, −1 for none.
        x: its posterior mean, standardised.
        nonlinear: whether any of them makes the ostium nonlinear (static).
    """
    cases, chooser = condition_settings(measured), selection(measured.n_conditions, 2)
    beat = sensor_model(effects, numbers, pair, nonlinear=nonlinear)
    sided = one_sided_unknowns(measured, numbers, pair)
    inside = jnp.where(sided > 0.5, jnp.maximum(x, 0.0), x)
    shown = dataclasses.replace(measured, held_out=jnp.zeros_like(measured.held_out))

    value, J, _ = by_condition(beat, measured.n_sensors, cases, jnp.asarray(chooser))(inside)
    uncertain = uncertain_signals(measured, effects, numbers, pair, inside, nonlinear=nonlinear)

    def linear_of(record: Measured) -> tuple[Whitened, Freedom]:
        W = whitener_of(record)
        slopes = W.columns(J)
        e = W(data_of(record) - value) + slopes @ inside
        return Whitened(e, slopes), uncertain.freedoms(W)

    def log_Z(linear: Whitened, freedom: Freedom, used: Array) -> Array:
        kept = Whitened(linear.e * used[:, None], linear.J * used[:, None, None])
        here = jax.tree.map(lambda a: a * used.reshape(-1, *[1] * (a.ndim - 1)), freedom)
        after = here.posterior(kept, sided)
        return after.log_evidence + log_prior_of_sizes(after, pair, sided)

    C = measured.n_conditions
    both = linear_of(measured), linear_of(shown)

    def densities(kind: Array) -> tuple[Array, Array]:
        fitted, revealed = ((linear, of_kind(freedoms, kind)) for linear, freedoms in both)
        # a condition of which nothing counts adds nothing: its whitened data are zero
        given = log_Z(*fitted, jnp.ones(C))
        without = jax.vmap(lambda k: log_Z(*fitted, 1.0 - k))(jnp.eye(C))
        return log_Z(*revealed, jnp.ones(C)) - given, (given - without) * (1.0 - measured.held_out)

    held_out, left_out = jax.lax.map(densities, jnp.arange(len(KINDS)))
    return Predicted(
        jnp.where(jnp.sum(measured.held_out) > 0.5, jnp.max(held_out), 0.0),
        left_out[jnp.argmax(jnp.sum(left_out, axis=1))],
    )
