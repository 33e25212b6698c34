"""Agreement of predicted and measured ratios: parity, Bland-Altman, RMSE.

With the differences e = predicted − measured of n patients::

    bias = mean(e),  sd = √(Σ(e − bias)²/(n − 1)),  limits = bias ± 1.96 sd,  RMSE = √(mean(e²))

Confidence limits of the bias: ± t sd/√n; of each limit of agreement: ± t √(3/n) sd, with Student's
t at 97.5 % and n − 1 degrees of freedom.

Source: Bland & Altman 1986, Lancet 327:307.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.stats

LIMIT = 1.96
"""Standard deviations to either side that hold 95 % of a normal distribution."""


class Agreement(NamedTuple):
    """How predicted and measured values agree.

    Attributes:
        n: pairs.
        bias: mean of predicted less measured.
        sd: standard deviation of the differences; nan for one pair.
        low: lower limit of agreement.
        high: upper limit.
        rmse: root mean square difference.
        r: Pearson's correlation; nan where it has none.
        bias_95: half width of the confidence interval of the bias.
        limit_95: the same of each limit.
    """

    n: int
    bias: float
    sd: float
    low: float
    high: float
    rmse: float
    r: float
    bias_95: float
    limit_95: float


def agreement(predicted: Sequence[float], measured: Sequence[float]) -> Agreement:
    """Compare pairs.

    Raises:
        ValueError: the numbers of values differ, or there are none.
    """
    p, m = np.asarray(predicted, float), np.asarray(measured, float)
    if p.shape != m.shape or not p.size:
        raise ValueError(
            f"{p.size} predicted and {m.size} measured values cannot be compared; give as many of"
            " each, at least one."
        )
    e, n = p - m, p.size
    bias, rmse = float(e.mean()), math.sqrt(float(np.mean(e**2)))
    sd = float(e.std(ddof=1)) if n > 1 else math.nan
    t = float(scipy.stats.t.ppf(0.975, n - 1)) if n > 1 else math.nan
    alike = n < 2 or np.ptp(p) == 0.0 or np.ptp(m) == 0.0
    r = math.nan if alike else float(np.corrcoef(p, m)[0, 1])
    return Agreement(
        n,
        bias,
        sd,
        bias - LIMIT * sd,
        bias + LIMIT * sd,
        rmse,
        r,
        t * sd / math.sqrt(n),
        t * sd * math.sqrt(3.0 / n),
    )
