"""Hypotheses "none", one effect, or two effects: their signals, and how uncertain these are.

All are one compiled function of the record and the positions i, j of the effects in the catalogue
(−1 for none), so that records and effects are batched by one map. Unknowns are those of
the base model and the standardised sizes of the two effects; an unused size has no effect on
anything and its prior integrates to one.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from diagnosis.circuit import SensorSpectra
from diagnosis.effects import SCALE, Effect, bounded_size
from diagnosis.form_columns import Freedom, form_freedom
from diagnosis.measured import Measured, Whitener, whitener_of
from diagnosis.prediction import (
    BYPASS_SD,
    OWN,
    SHARED,
    TRANSMISSION_SD,
    ConditionSettings,
    as_waves,
    condition_settings,
    n_unknowns,
    observations,
    predict,
    selection,
)

BED_FORM = 0.1
"""Relative uncertainty of what the muscle's squeeze does to the signals: a bed has several layers,
whose pressures, compliances and volumes differ, and the base model has one; assumed."""

BED_ALIKE = 0.9
"""Correlation of this error between conditions; assumed."""

GUESSED_TRANSMISSION, GUESSED_BYPASS = 0.07, 0.15
"""Standard deviations of the ratio of intramyocardial to ventricular pressure and of the bypass,
see `prediction`, where equations are guessed; assumed (the pressure falls from the endocardium to
nearly zero at the epicardium: Hoffman & Spaan 1990, Physiol Rev 70:331)."""

BOTH = np.ones(2)
"""Shares of both effects of a hypothesis."""

_TRANSMISSION, _BYPASS = SHARED.index("transmission"), SHARED.index("bypass")

FITTED = np.nan
"""In place of a fixed size: the size is an unknown of the fit."""


class Catalogue(NamedTuple):
    """The numbers of a list of effects, as arrays.

    Attributes:
        sd: width s of each size's prior, see `effects`.
        one_sided: 1 where only positive sizes exist.
        tolerance: freedom of the form.
    """

    sd: Float[Array, " e"]
    one_sided: Float[Array, " e"]
    tolerance: Float[Array, " e"]


def numbers_of(effects: Sequence[Effect], prior_scale: float = 1.0) -> Catalogue:
    """The numbers of effects; `prior_scale` multiplies the width of every prior."""
    return Catalogue(
        jnp.asarray(np.array([prior_scale * SCALE * e.sd for e in effects])),
        jnp.asarray(np.array([float(e.one_sided) for e in effects])),
        jnp.asarray(np.array([e.tolerance for e in effects])),
    )


def places_of(numbers: Catalogue, pair: Int[Array, " 2"]) -> Float[Array, "2 e"]:
    """Selection matrix of the hypothesis: 1 at the position of each effect, else 0."""
    return (pair[:, None] == jnp.arange(numbers.sd.shape[0])[None, :]).astype(float)


def effect_sizes(
    numbers: Catalogue, pair: Int[Array, " 2"], x: Float[Array, " 2"]
) -> Float[Array, " e"]:
    """Size of every effect of the catalogue [its unit] from the two standardised ones."""
    return bounded_size(numbers.sd, numbers.one_sided, x @ places_of(numbers, pair))


def one_sided_unknowns(
    measured: Measured, numbers: Catalogue, pair: Int[Array, " 2"]
) -> Float[Array, " k"]:
    """1 for the unknowns of a hypothesis that only exist above zero, else 0."""
    of_sizes = places_of(numbers, pair) @ numbers.one_sided
    return jnp.concatenate([jnp.zeros(n_unknowns(measured)), of_sizes])


def sensor_model(
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    fixed_size: Float[ArrayLike, ""] = FITTED,
    *,
    nonlinear: bool,
) -> Callable[..., SensorSpectra]:
    """Signals of the sensors under a hypothesis, as a function of a condition and its unknowns.

    Arguments are those of `fit_about`. The function takes `forced` as `predict` does, and
    `share`, by which the two sizes are multiplied.
    """
    free = jnp.stack([jnp.isnan(fixed_size), jnp.asarray(True)])
    fixed = jnp.stack([jnp.asarray(fixed_size), jnp.zeros(())])

    def beat(
        case: ConditionSettings,
        own: Array,
        forced: Array | None = None,
        share: Float[ArrayLike, " 2"] = BOTH,
    ) -> SensorSpectra:
        sized = jnp.asarray(share) * jnp.where(free, own[OWN:], fixed)
        sizes = effect_sizes(numbers, pair, sized)
        return predict(case, own[:OWN], effects, sizes, nonlinear=nonlinear, forced=forced)

    return beat


class UncertainSignals(NamedTuple):
    """Signals of the sensors, and how uncertain equations make them, see `evidence`.

    Attributes:
        power: variance of the signals [their units squared] by a guessed form and what instruments
            share between beats, and by a bed of another structure.
        scalar_power: variance of the last four data.
        bed: change of the data by one standard deviation of the transmission, and of the bypass,
            that guessed equations have beside exact ones.
        n_sensors: number of sensors with a waveform.
    """

    power: Float[Array, "2 c 3 n"]
    scalar_power: Float[Array, "2 c 4"]
    bed: Float[Array, "c d 2"]
    n_sensors: int

    def freedoms(self, W: Whitener, *, with_bed: bool = True) -> Freedom:
        """Freedom of both kinds of guessed equations, whitened, along a leading axis.

        Args:
            W: whitener of the record.
            with_bed: whether it holds the further transmission and bypass; not where these
                unknowns themselves are as wide as `guessed_widths`.
        """
        n = self.n_sensors
        form, bed = self.power[:, :, :n]
        form_scalars, bed_scalars = self.scalar_power

        def kind(other_bed: Array) -> Freedom:
            own, alike = other_bed * (1.0 - BED_ALIKE), other_bed * BED_ALIKE
            return form_freedom(
                W, form + own * bed, form_scalars + own * bed_scalars,
                alike * bed, alike * bed_scalars, self.bed if with_bed else self.bed[..., :0],
            )  # fmt: skip

        return jax.lax.map(kind, jnp.asarray([0.0, 1.0]))


def guessed_widths(n_unknowns: int) -> Float[np.ndarray, " k"]:
    """Prior standard deviations of a hypothesis's unknowns where equations are guessed.

    They are in units of those where they are exact: one, but for transmission and bypass.
    """
    widths = np.ones(n_unknowns)
    widths[_TRANSMISSION] = GUESSED_TRANSMISSION / TRANSMISSION_SD
    widths[_BYPASS] = GUESSED_BYPASS / BYPASS_SD
    return widths


def of_kind(freedoms: Freedom, kind: Int[Array, ""]) -> Freedom:
    """Freedom of one of `KINDS`: none where equations are exact."""
    at = jnp.maximum(kind - 1, 0)
    return jax.tree.map(lambda a: jnp.where(kind == 0, 0.0, a[at]), freedoms)


def likeliest_freedom(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    kinds: Float[Array, " 3"],
    *,
    nonlinear: bool,
) -> Freedom:
    """Freedom of the likeliest kind of equations of a hypothesis, whitened.

    Arguments are those of `fit_about`, x its optimum, and the probabilities of the kinds.
    """
    uncertain = uncertain_signals(measured, effects, numbers, pair, x, nonlinear=nonlinear)
    return of_kind(uncertain.freedoms(whitener_of(measured)), jnp.argmax(kinds))


def uncertain_signals(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    fixed_size: Float[ArrayLike, ""] = FITTED,
    *,
    nonlinear: bool,
) -> UncertainSignals:
    """Uncertainty of the signals by that of a hypothesis's equations.

    Arguments are those of `fit_about`, and x its optimum.
    """
    own = jnp.asarray(selection(measured.n_conditions, 2)) @ x
    cases, n = condition_settings(measured), measured.n_sensors
    beat = sensor_model(effects, numbers, pair, fixed_size, nonlinear=nonlinear)
    tolerances = places_of(numbers, pair) @ numbers.tolerance

    def signals(share: Array, squeeze: Array, bypass: Array) -> tuple[Array, Array]:
        unlike = own.at[:, _TRANSMISSION].set(
            jnp.where(squeeze > 0.5, own[:, _TRANSMISSION], -1.0 / TRANSMISSION_SD)
        )
        unlike = unlike.at[:, _BYPASS].add(bypass)
        seen = jax.vmap(partial(beat, share=share))(cases, unlike)
        return jax.vmap(as_waves)(seen), jax.vmap(lambda b: observations(b, n))(seen)

    # with both effects, without the first, without the second; with both, without the squeeze;
    # with both and more bypass
    more = _beside(GUESSED_BYPASS, BYPASS_SD)
    shares = jnp.asarray(np.array([[1.0, 1.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0]]))
    squeezes = jnp.asarray(np.array([1.0, 1.0, 1.0, 0.0, 1.0]))
    bypasses = jnp.asarray(np.array([0.0, 0.0, 0.0, 0.0, more / BYPASS_SD]))
    waves, data = jax.vmap(signals)(shares, squeezes, bypasses)

    def power(signal: Array) -> Array:
        change = signal[:1] - signal[1:4]
        form = jnp.einsum("s,sc...->c...", tolerances**2, change[:2] ** 2)
        return jnp.stack([form, BED_FORM**2 * change[2] ** 2])

    squeezed = _beside(GUESSED_TRANSMISSION, TRANSMISSION_SD) * (data[0] - data[3])
    bed = jnp.stack([squeezed, data[4] - data[0]], axis=-1)
    own_power = power(waves)
    if measured.instrument_sd is not None:
        pressures = jnp.asarray(np.array([1.0, 1.0, 0.0]))[:, None]
        own_power = own_power.at[0].add(measured.instrument_sd**2 * pressures)
    return UncertainSignals(own_power, power(data[..., -4:]), bed, n)


def _beside(whole: float, part: float) -> float:
    """Standard deviation of what makes a part the whole."""
    return float(np.sqrt(whole**2 - part**2))


def by_condition(
    beat: Callable[[ConditionSettings, Array], SensorSpectra],
    n_sensors: int,
    cases: ConditionSettings,
    chooser: Float[Array, "c o k"],
) -> Callable[[Array], tuple[Array, Array, SensorSpectra]]:
    """Predicted data of all conditions, their derivatives, and the signals, as a function of x.

    Args:
        beat: signals of a condition with its unknowns.
        n_sensors: number of sensors with a waveform.
        cases: the conditions.
        chooser: see `prediction.selection`.
    """

    def one(case: ConditionSettings, own: Array) -> tuple[Array, Array, SensorSpectra]:
        def with_value(own: Array) -> tuple[Array, tuple[Array, SensorSpectra]]:
            seen = beat(case, own)
            value = observations(seen, n_sensors)
            return value, (value, seen)

        J, (value, seen) = jax.jacfwd(with_value, has_aux=True)(own)
        return value, J, seen

    def slopes(x: Array) -> tuple[Array, Array, SensorSpectra]:
        value, J, seen = jax.vmap(one)(cases, chooser @ x)
        return value, jnp.einsum("cdo,cok->cdk", J, chooser), seen

    return slopes


def whitened_by_condition(
    beat: Callable[[ConditionSettings, Array], SensorSpectra],
    measured: Measured,
    chooser: Float[Array, "c o k"],
) -> Callable[[Array], tuple[Array, Array, SensorSpectra]]:
    """What `by_condition` gives, data and derivatives whitened."""
    W = whitener_of(measured)
    plain = by_condition(beat, measured.n_sensors, condition_settings(measured), chooser)

    def slopes(x: Array) -> tuple[Array, Array, SensorSpectra]:
        value, J, seen = plain(x)
        return W(value), W.columns(J), seen

    return slopes
