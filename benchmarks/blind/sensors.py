"""What catheters and wires make of the true pressures, and their noise."""

import numpy as np

from benchmarks.blind.truth import SAMPLED, Lanes

DRIFT_STEPS = (0.0, 1.0, 1.9, 3.1)
"""Offset of a drifting wire by order of acquisition, over its size."""


def _filtered(wave: np.ndarray, response: np.ndarray) -> np.ndarray:
    return np.fft.irfft(np.fft.rfft(wave, axis=-1) * response, SAMPLED, axis=-1)


def seen(true: dict[str, np.ndarray], lanes: Lanes) -> dict[str, np.ndarray]:
    """Traces as instruments show them, without noise."""
    e, n = lanes["sizes"], lanes["period"].size

    def size(name: str) -> np.ndarray:
        return e.get(name, np.zeros(n))[:, None]

    period = lanes["period"][:, None]
    omega = 2.0 * np.pi * np.arange(SAMPLED // 2 + 1)[None, :] / period
    lag = size("catheter_damping")
    own = np.where(lag > 0.0, 1.2 / np.maximum(lag, 1e-6), 1e9)
    ratio = omega / own
    P_aorta = _filtered(true["P_aorta"], 1.0 / (1.0 - ratio**2 + 1.2j * ratio))
    P_aorta = P_aorta + size("aortic_zero_error")

    # of second order, half critically damped: the natural frequency is 1/lag
    ratio = omega * size("distal_damping")
    P = _filtered(true["P_distal"], 1.0 / (1.0 - ratio**2 + 1.0j * ratio))
    shift = size("signal_delay") / period * SAMPLED
    index = np.arange(SAMPLED)[None, :] - shift
    low = np.floor(index).astype(int)
    part = index - low
    rows = np.arange(n)[:, None]
    P = (1.0 - part) * P[rows, low % SAMPLED] + part * P[rows, (low + 1) % SAMPLED]
    back = np.roll(P, round(0.15 * SAMPLED), axis=1)
    P = P + size("echo") * (back - back.mean(axis=1, keepdims=True))
    phase = np.arange(SAMPLED)[None, :] / SAMPLED
    whip = np.sin(2.0 * np.pi * 9.0 * phase) * np.exp(-0.5 * ((phase - 0.15) / 0.06) ** 2)
    P = P + size("whip") * whip
    cut = size("clipping")
    top = P.min(axis=1, keepdims=True) + cut * np.ptp(P, axis=1, keepdims=True)
    P = np.where(cut > 0.0, np.minimum(P, top), P)
    P = P * (1.0 + size("sensor_gain"))
    steps = np.array(DRIFT_STEPS)[lanes["order"].astype(int)][:, None]
    P = P + size("sensor_height") + steps * size("wire_drift")
    return {"P_aorta": P_aorta, "P_distal": P, "Q": true["Q"]}


def noise(rng: np.random.Generator, shape: tuple[int, int], sd: float) -> np.ndarray:
    """Half white, half correlated over 0.05 beat; traces × samples."""
    phase = np.arange(SAMPLED) / SAMPLED
    gap = np.abs(phase[:, None] - phase[None, :])
    gap = np.minimum(gap, 1.0 - gap)
    K = np.exp(-0.5 * (gap / 0.05) ** 2) + 1e-6 * np.eye(SAMPLED)
    value, vector = np.linalg.eigh(K)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    white, smooth = rng.standard_normal((2, *shape))
    return sd * np.sqrt(0.5) * (white + smooth @ root.T)
