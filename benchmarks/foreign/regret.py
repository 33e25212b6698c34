"""Regret of a method against the oracle, over the records that both answered.

    regret = mean [ln max(p_oracle(truth), 0.01) − ln max(p_method(truth), 0.01)]

The probability of a truth is that of its hypothesis alone; that of a cause outside the list is
"unknown". A 90 % interval comes from the bootstrap over records (Efron 1979, Ann Stat 7:1).
"""

from typing import Any

import numpy as np

FLOOR = 0.01
"""Least probability that counts: one certain error costs ln 100."""

DRAWS, INTERVAL = 2000, (5.0, 95.0)
"""Resamplings, and the percentiles of the interval."""

Row = dict[str, Any]


def log_score(row: Row) -> float:
    """Logarithm of the probability of the truth, floored."""
    truth = "unknown" if row["truth"].startswith("outside") else row["truth"]
    return float(np.log(max(row["probabilities"].get(truth, 0.0), FLOOR)))


def log_regret(pairs: list[tuple[Row, Row]]) -> tuple[float, float, float]:
    """Mean regret and its interval.

    Args:
        pairs: rows of the method and of the oracle for the same record.
    """
    each = np.array([log_score(oracle) - log_score(own) for own, oracle in pairs])
    rng = np.random.default_rng(0)
    means = each[rng.integers(each.size, size=(DRAWS, each.size))].mean(axis=1)
    low, high = np.percentile(means, INTERVAL)
    return float(each.mean()), float(low), float(high)
