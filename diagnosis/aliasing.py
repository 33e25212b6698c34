"""What few samples a beat fold back: harmonics beyond half their number seem lower ones.

With n samples a beat harmonic n − k is seen as harmonic k. How large it is cannot be read from the
samples; pressures and flows with steep parts fall as 1/k² there::

    E|c_{n−k}|² ≈ (mean |c|² − noise) at k₀ · (k₀/(n − k))⁴

with k₀ the middle of the highest third of what is seen. A record system with a filter folds less
back. Where beats are folded on a clock of its own, every beat has other phases and nothing stays.
"""

import numpy as np

from diagnosis.resolution import HARMONICS


def aliased_power(beat: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Variance over 2 of what is folded back on the kept harmonics, the mean first.

    Args:
        beat: samples of the mean beat.
        noise: variance over 2 of its harmonics; infinite where they are not seen.
    """
    n = beat.size
    c = np.abs(np.fft.rfft(beat) / n) ** 2
    highest = np.arange(max(n // 3, 1), min((n + 1) // 2, HARMONICS + 1))
    if highest.size == 0:
        return np.zeros(HARMONICS + 1)
    middle = np.sqrt(highest[0] * highest[-1])
    level = max(float(np.mean(c[highest] - noise[highest])), 0.0)
    beyond = np.maximum(n - np.arange(HARMONICS + 1), 0.5 * n)
    return level * (middle / beyond) ** 4
