"""Baselines that answer a foreign set from the base model's fit alone, by the challenge's form.

| method | what it is |
|---|---|
| `regime` | where the model fails, and the one term whose lack explains it (`regimes`) |
| `boosted` | trees on features of the fit, grown on own simulations (`boosted`) |
| `amortised` | a network that gives the posterior of cause and size (`amortised`) |

The two that learn give probabilities, and from them a verdict: "no_gap" if none is first, "unknown"
if that is first, "named" if an effect has `NAMED` or more, else "ambiguous".
"""

import pathlib
import sys
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from benchmarks.blind.truth import RANGES
from benchmarks.foreign.amortised import PosteriorNetwork, blank, trained
from benchmarks.foreign.answers import earlier, keep
from benchmarks.foreign.boosted import boosted
from benchmarks.foreign.features import features_of
from benchmarks.foreign.plain import PlainFit, in_batches, plain_fits
from benchmarks.foreign.regimes import regime_entry
from benchmarks.foreign.training import CLASSES, NONE, UNKNOWN, Training, load, train
from diagnosis import CATALOGUE, find_effect
from study.store.cache_folder import use_cache

METHODS = ("regime", "boosted", "amortised")

NAMED, COVER = 0.8, 0.9
"""Probability from which an effect is named, and of the effects that an ambiguous answer lists."""

NETWORK = "amortised.eqx"
"""File of the trained network in the folder of a training."""

Entry = dict[str, Any]


def train_methods(folder: pathlib.Path, records: int, seed: int) -> None:
    """Simulate records, keep their features, and train the network; trees grow when they answer.

    Args:
        folder: of the training.
        records: how many.
        seed: of everything.
    """
    simulations = train(folder, records, seed)
    network = trained(
        simulations.features, simulations.cause, _standardised(simulations), len(CLASSES), seed=seed
    )
    eqx.tree_serialise_leaves(folder / NETWORK, network)


def _standardised(simulations: Training) -> Float[np.ndarray, " n"]:
    """Sizes over the root mean square that the catalogue expects."""
    return simulations.size / _root_mean_squares()[simulations.cause]


def _root_mean_squares() -> Float[np.ndarray, " c"]:
    return np.array([find_effect(CATALOGUE, c).sd if c in RANGES else 1.0 for c in CLASSES])


def answer_with(
    folder: pathlib.Path,
    method: str,
    records: int | None = None,
    training: pathlib.Path | None = None,
) -> None:
    """Answer a set by a baseline: `answers-METHOD.json`; answers that are there already are kept.

    Args:
        folder: a set.
        method: one of `METHODS`.
        records: only so many of them.
        training: folder of `train`, for methods that learn.

    Raises:
        ValueError: the method learns and no training is given.
    """
    use_cache()
    found = earlier(folder, method)
    places = sorted((folder / "records").iterdir())[:records]
    left = [place for place in places if place.name not in found]
    entry = _entry_by(method, training) if left else regime_entry
    done = len(places) - len(left)
    for at, own, batch in in_batches(left):
        for place, fit in zip(at, plain_fits(own, batch), strict=True):
            found[place.name] = entry(fit) if fit.sound else _certain(UNKNOWN)
        done += len(at)
        keep(folder, method, found)
        print(f"{done} of {len(places)}", file=sys.stderr, flush=True)


def _entry_by(method: str, training: pathlib.Path | None) -> Callable[[PlainFit], Entry]:
    """The function that answers a record."""
    if method == "regime":
        return regime_entry
    if training is None:
        raise ValueError(
            f"'{method}' learns from simulations. Write some with `train FOLDER`, and give the "
            "folder as --training."
        )
    simulations = load(training)
    if method == "boosted":
        probabilities = boosted(simulations)
        return lambda fit: entry_of(probabilities(features_of(fit)[None])[0])
    skeleton = blank(simulations.features.shape[1], len(CLASSES), jax.random.key(0))
    network = eqx.tree_deserialise_leaves(training / NETWORK, skeleton)
    return lambda fit: network_entry(network, features_of(fit))


def network_entry(network: PosteriorNetwork, features: Float[np.ndarray, " k"]) -> Entry:
    """The entry of a network; "sizes" holds mean and sd of effects that have a probability."""
    log_q, mean, sd = (np.asarray(own) for own in network(jnp.asarray(features)))
    p, scale = np.exp(log_q), _root_mean_squares()
    sizes = {
        name: [round(float(mean[k] * scale[k]), 5), round(float(sd[k] * scale[k]), 5)]
        for k, name in enumerate(CLASSES)
        if name in RANGES and p[k] >= 0.05
    }
    return {**entry_of(p), "sizes": sizes}


def entry_of(p: Float[np.ndarray, " c"]) -> Entry:
    """The entry of probabilities of `CLASSES`."""
    order = [CLASSES[k] for k in np.argsort(-p, kind="stable")]
    of = dict(zip(CLASSES, (float(v) for v in p), strict=True))
    effects = [name for name in order if name not in (NONE, UNKNOWN)]
    mass = np.cumsum([of[name] for name in effects])
    set_of_effects = effects[: int(np.searchsorted(mass, COVER * mass[-1])) + 1]
    if order[0] == NONE:
        verdict, named = "no_gap", []
    elif order[0] == UNKNOWN:
        verdict, named = "unknown", effects[:1]
    elif of[order[0]] >= NAMED:
        verdict, named = "named", effects[:1]
    else:
        verdict, named = "ambiguous", set_of_effects
    kept = {name: round(of[name], 5) for name in order if of[name] > 5e-6}
    return {"verdict": verdict, "named": named, "probabilities": kept}


def _certain(name: str) -> Entry:
    """The entry of a record whose base model cannot be fitted."""
    return {"verdict": name, "named": [], "probabilities": {name: 1.0}}
