"""Means, least and largest values of each cycle of a run in 3D."""

from typing import Any

import numpy as np

from jaxfsi.simulation import Record
from lumped import ML_PER_MIN, MMHG
from study.run.openings import INLET, SEGMENT_INLET, distal_name


def cycle_means(record: Record, names: tuple[str, ...], period: float) -> list[dict[str, Any]]:
    """Means, least and largest values of each opening in each cycle, steps weighed by length."""
    if not record.n_steps:
        return []
    number = np.floor((record.t - 0.5 * record.dt) / period).astype(int)
    found = []
    for k in range(int(number[-1]) + 1):
        part = number == k
        weight = record.dt[part] / record.dt[part].sum()
        ports = {
            name: _spread(
                record.P_port[part, i] / MMHG, record.Q_port[part, i] / ML_PER_MIN, weight
            )
            for i, name in enumerate(names)
            if is_opening(name)
        }
        means = {name: entry["mean_P_mmHg"] for name, entry in ports.items()}
        distal = distal_name(means)
        aorta = means.get(INLET, means.get(SEGMENT_INLET))
        found.append(
            {
                "cycle": k + 1,
                "complete": bool(record.dt[part].sum() > period * (1.0 - 1e-6)),
                "ports": ports,
                "ratio": means[distal] / aorta if distal and aorta else None,
                "net_outflow_ml": float(
                    np.sum(record.dt[part, None] * record.Q_port[part][:, opening_indices(names)])
                ),
            }
        )
    return found


def is_opening(name: str) -> bool:
    """Whether a port is an opening: the outside of the wall is a port of the model alone."""
    return name != "outer_wall"


def opening_indices(names: tuple[str, ...]) -> list[int]:
    """Indices of the openings among the ports."""
    return [i for i, name in enumerate(names) if is_opening(name)]


def _spread(P: np.ndarray, Q: np.ndarray, weight: np.ndarray) -> dict[str, float]:
    return {
        "mean_P_mmHg": float(weight @ P),
        "least_P_mmHg": float(P.min()),
        "largest_P_mmHg": float(P.max()),
        "mean_Q_ml_per_min": float(weight @ Q),
        "least_Q_ml_per_min": float(Q.min()),
        "largest_Q_ml_per_min": float(Q.max()),
    }
