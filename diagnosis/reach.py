"""Whether boundary parameters alone reach a record, and which loss of the artery would.

*Boundary alone.* The base model has the bed, α, the compliances and the pressures as unknowns, and
ln R0 within what is known of it, x_0 ~ N(0, 1) in units of its standard deviation s_0. It reaches
the record where its misfit is one of noise (`verdict.CLOSED_P`) and R0 stays within what is known:
x_0 has prior variance 1 and posterior variance v, so that its posterior mean m has the variance
1 − v before the data are seen, and

    pull = m/√(1 − v)

is a standard normal number unless R0 itself is in doubt.

*The loss wanted.* With the effect `proximal_resistance` of size φ the artery's loss has the factor
exp(t), t = s_0 x_0 + φ, on R0 and K alike. Data know the sum only: its posterior mean and standard
deviation follow from the covariance of both.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.special import chdtrc

from diagnosis.effects import Effect
from diagnosis.evidence import Whitened
from diagnosis.hypothesis import (
    Catalogue,
    likeliest_freedom,
    numbers_of,
    one_sided_unknowns,
    sensor_model,
    whitened_by_condition,
)
from diagnosis.measured import Measured, data_of, whitener_of
from diagnosis.prediction import SHARED, n_unknowns, selection
from diagnosis.result import Diagnosis
from diagnosis.verdict import CLOSED_P, Hypothesis, is_closed
from lumped.device import QUICK_TO_COMPILE

RESISTANCE = "proximal_resistance"
"""The effect that changes the artery's loss."""

FARTHEST_PULL = 2.6
"""Standard deviations that R0 may lie from what is known of it: one record in a hundred."""

_R0 = SHARED.index("R0")
_LEAST_LEARNT = 1e-6  # of the variance of x_0, below which data say nothing of R0


class Reach(NamedTuple):
    """What of a record is reached, and the loss that it wants.

    Attributes:
        boundary: whether boundary parameters alone reach it.
        p_value: chance that noise leaves the misfit of the base model [-].
        pull: of R0, see above [sd of what is known].
        hypothesis: the effects with which the loss was found.
        free: whether they close the gap.
        p_value_free: chance that noise leaves their misfit [-].
        log_factor: posterior mean of t, ln of the loss wanted over the known one [-].
        log_factor_sd: its standard deviation [-].
        flow: mean flow of the fitted conditions with them [cm³/s].
    """

    boundary: bool
    p_value: float
    pull: float
    hypothesis: Hypothesis
    free: bool
    p_value_free: float
    log_factor: float
    log_factor_sd: float
    flow: float


def reach(diagnosis: Diagnosis) -> Reach:
    """What boundary parameters alone reach of a record, and the loss of the artery that would.

    The loss is that of the most probable hypothesis where this changes R0, else that of R0 alone.
    Each covariance is that of the model that was fitted: beside the recorded aortic waveform, of
    the record with its free inlet.

    Raises:
        ValueError: the diagnosis has no effect on the artery's resistance.
    """
    best = diagnosis.judgement.best
    hypothesis = best if RESISTANCE in best else (RESISTANCE,)
    if hypothesis not in diagnosis.fits:
        raise ValueError(
            f"the diagnosis holds no fit with {RESISTANCE}: diagnose with the effects of the"
            " catalogue."
        )
    record = diagnosis.record
    fitted_to, effects = diagnosis.fitted_about(hypothesis)
    numbers, k = numbers_of(effects), n_unknowns(record)
    pairs = [[-1, -1], [*range(len(effects)), -1][:2]]
    fits = [diagnosis.base, diagnosis.fits[hypothesis]]
    nonlinear = any(effect.nonlinear for effect in effects)
    before, after = (
        np.asarray(
            _covariance(
                about, effects, numbers, jnp.asarray(pair), jnp.asarray(fit.x),
                jnp.asarray(fit.kinds), nonlinear=nonlinear,
            )
        )
        for about, pair, fit in zip((record, fitted_to), pairs, fits, strict=True)
    )  # fmt: skip
    learnt = 1.0 - float(before[_R0, _R0])
    pull = float(fits[0].x[_R0]) / float(np.sqrt(learnt)) if learnt > _LEAST_LEARNT else 0.0

    place = [effect.id for effect in effects].index(RESISTANCE)
    along = np.zeros(len(after))
    along[_R0], along[k + place] = float(record.R0_sd_log), float(numbers.sd[place])
    p_before, p_after = (_p_value(diagnosis, h) for h in ((), hypothesis))
    misfits = [float(fit.misfit) for fit in fits]
    count = k + len(hypothesis)
    shown = np.asarray(record.held_out) < 0.5
    return Reach(
        boundary=p_before > CLOSED_P and abs(pull) <= FARTHEST_PULL,
        p_value=p_before,
        pull=pull,
        hypothesis=hypothesis,
        free=bool(is_closed(misfits[1], misfits[0], diagnosis.n_data, count)),
        p_value_free=p_after,
        log_factor=float(along @ np.asarray(fits[1].x)),
        log_factor_sd=float(np.sqrt(along @ after @ along)),
        flow=float(np.asarray(fits[1].waves)[shown, 2].mean()),
    )


def _p_value(diagnosis: Diagnosis, hypothesis: Hypothesis) -> float:
    """Chance that noise leaves the misfit of a hypothesis, as the verdict counts it."""
    fitted = n_unknowns(diagnosis.record) + len(hypothesis)
    misfit = float(diagnosis.fits[hypothesis].misfit)
    return float(chdtrc(max(diagnosis.n_data - fitted, 1), misfit))


@partial(jax.jit, static_argnames=("effects", "nonlinear"), compiler_options=QUICK_TO_COMPILE)
def _covariance(
    measured: Measured,
    effects: tuple[Effect, ...],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    kinds: Float[Array, " 3"],
    *,
    nonlinear: bool,
) -> Float[Array, "k k"]:
    """Posterior covariance of a hypothesis about its fit; arguments as of `likeliest_freedom`."""
    W, chooser = whitener_of(measured), jnp.asarray(selection(measured.n_conditions, 2))
    beat = sensor_model(effects, numbers, pair, nonlinear=nonlinear)
    model = whitened_by_condition(beat, measured, chooser)
    sided = one_sided_unknowns(measured, numbers, pair)
    inside = jnp.where(sided > 0.5, jnp.maximum(x, 0.0), x)
    value, J, _ = model(inside)
    freedom = likeliest_freedom(
        measured, effects, numbers, pair, inside, kinds, nonlinear=nonlinear
    )
    residual = W(data_of(measured)) - value
    return freedom.posterior(Whitened(residual + J @ inside, J), sided).covariance
