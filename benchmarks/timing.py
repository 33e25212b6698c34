"""Timing of several functions in turn, compile time apart from warm calls."""

import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import jax


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Result of a call and its wall time [s], waiting for JAX to finish."""
    start = time.perf_counter()
    result = jax.block_until_ready(function())
    return result, time.perf_counter() - start


def in_turn(
    functions: Mapping[str, Callable[[], Any]], rounds: int
) -> tuple[dict[str, Any], dict[str, dict[str, float]]]:
    """Call all functions once, then `rounds` times in turn (A B C, A B C).

    Returns:
        The last result of each, and its times: first call (compilation included), median, least
        and largest of the later ones [s].
    """
    results: dict[str, Any] = {}
    first = {}
    for name, function in functions.items():
        results[name], first[name] = timed(function)
    later: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds):
        for name, function in functions.items():
            results[name], seconds = timed(function)
            later[name].append(seconds)
    times = {
        name: {
            "first_s": first[name],
            "median_s": statistics.median(values),
            "min_s": min(values),
            "max_s": max(values),
        }
        for name, values in later.items()
    }
    return results, times
