"""Baseline `boosted`: gradient boosting of trees on the features of the base model's fit.

Trees are grown one class at a time on the gradient of the multinomial deviance. What they say is
too sure; a temperature T, chosen on a fifth of the simulations that a first fit has not seen,
softens it: p ∝ p̂^(1/T).

Source: Friedman 2001 (Ann Stat 29:1189); histograms: Ke et al. 2017 (NeurIPS 30), as in
scikit-learn; temperature: Guo et al. 2017 (ICML, PMLR 70:1321).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.foreign.training import CLASSES, Training

Probabilities = Callable[[Float[np.ndarray, "n k"]], Float[np.ndarray, "n c"]]

LEAST = 1e-6
"""Probability of a class that trees exclude."""

TEMPERATURES = np.geomspace(0.5, 8.0, 41)


def boosted(training: Training, *, rounds: int = 80, seed: int = 0) -> Probabilities:
    """Trained trees: probabilities of `CLASSES` by features.

    Args:
        training: simulations.
        rounds: of boosting.
        seed: of the split.

    Raises:
        ImportError: scikit-learn is not installed.
    """
    n = training.cause.size
    order = np.random.default_rng(seed).permutation(n)
    fitted, held = order[n // 5 :], order[: n // 5]
    draft = _grown(training.features[fitted], training.cause[fitted], rounds, seed)
    T = temperature_of(draft(training.features[held]), training.cause[held])
    grown = _grown(training.features, training.cause, rounds, seed)
    return lambda features: softened(grown(features), T)


def _grown(features: np.ndarray, cause: np.ndarray, rounds: int, seed: int) -> Probabilities:
    try:
        from sklearn.ensemble import HistGradientBoostingClassifier
    except ImportError as error:
        raise ImportError(
            "scikit-learn is not installed, which grows the trees. Try: pip install "
            "'jaxfsi[benchmark]'"
        ) from error

    settings: dict[str, Any] = {"early_stopping": False}
    trees = HistGradientBoostingClassifier(
        max_iter=rounds, learning_rate=0.08, max_leaf_nodes=8, min_samples_leaf=5,
        l2_regularization=1.0, max_features=0.3, random_state=seed, **settings,
    )  # fmt: skip
    trees.fit(features, cause)
    known = np.unique(cause)

    def probabilities(features: np.ndarray) -> np.ndarray:
        found = np.full((features.shape[0], len(CLASSES)), LEAST)
        found[:, known] = np.maximum(trees.predict_proba(features), LEAST)
        return found / found.sum(axis=1, keepdims=True)

    return probabilities


def softened(p: Float[np.ndarray, "n c"], T: float) -> Float[np.ndarray, "n c"]:
    """Probabilities at a temperature."""
    powered = (p / p.max(axis=1, keepdims=True)) ** (1.0 / T)
    return powered / powered.sum(axis=1, keepdims=True)


def temperature_of(p: Float[np.ndarray, "n c"], cause: np.ndarray) -> float:
    """The temperature that makes causes likeliest; 1 without any."""
    if cause.size == 0:
        return 1.0
    rows = np.arange(cause.size)
    losses = [-np.log(softened(p, T)[rows, cause]).mean() for T in TEMPERATURES]
    return float(TEMPERATURES[int(np.argmin(losses))])
