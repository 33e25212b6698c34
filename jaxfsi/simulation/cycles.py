"""Means, least and largest values of each cycle of a run, and its pressures over time.

Pressures are in mmHg and flows in mL/min, as their names say: these are the numbers that results
show.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxfsi.opening import INLET, SEGMENT_INLET, distal_name, inlet_name, is_opening
from jaxfsi.simulation.record import StepHistory, port_flow, port_pressure
from lumped.units import ML_PER_MIN, MMHG


@dataclasses.dataclass(frozen=True)
class PortMeans:
    """An opening over a cycle.

    Attributes:
        mean_P_mmHg: mean pressure.
        least_P_mmHg: least pressure.
        largest_P_mmHg: largest pressure.
        mean_Q_ml_per_min: mean flow out of the domain.
        least_Q_ml_per_min: least flow.
        largest_Q_ml_per_min: largest flow.
    """

    mean_P_mmHg: float
    least_P_mmHg: float
    largest_P_mmHg: float
    mean_Q_ml_per_min: float
    least_Q_ml_per_min: float
    largest_Q_ml_per_min: float


@dataclasses.dataclass(frozen=True)
class CycleMeans:
    """A cycle of a run.

    Attributes:
        cycle: its number, from 1.
        complete: whether the run holds all of it.
        ports: its openings by name.
        ratio: mean distal over mean aortic pressure [-]; None where there is no distal outlet.
        net_outflow_ml: volume that left through all openings.
    """

    cycle: int
    complete: bool
    ports: dict[str, PortMeans]
    ratio: float | None
    net_outflow_ml: float


class Inlet(NamedTuple):
    """The aortic pressure over a run.

    Attributes:
        t: times [s].
        P_mmHg: pressure at these times [mmHg].
    """

    t: Float[np.ndarray, " times"]
    P_mmHg: Float[np.ndarray, " times"]


def cycle_means(record: StepHistory, names: tuple[str, ...], period: float) -> list[CycleMeans]:
    """Means, least and largest values of each opening in each cycle, steps weighed by length.

    Args:
        record: of the run.
        names: of the ports of its model, in their order.
        period: length of a cycle [s].
    """
    if not record.n_steps:
        return []
    openings = [i for i, name in enumerate(names) if is_opening(name)]
    number = np.floor((record.t - 0.5 * record.dt) / period).astype(int)
    found = []
    for k in range(int(number[-1]) + 1):
        part = number == k
        weight = record.dt[part] / record.dt[part].sum()
        ports = {
            names[i]: _spread(
                record.P_port[part, i] / MMHG, record.Q_port[part, i] / ML_PER_MIN, weight
            )
            for i in openings
        }
        distal = distal_name(ports)
        aorta = ports.get(INLET, ports.get(SEGMENT_INLET))
        ratio = None
        if distal and aorta is not None and aorta.mean_P_mmHg:
            ratio = ports[distal].mean_P_mmHg / aorta.mean_P_mmHg
        outflow = np.sum(record.dt[part, None] * record.Q_port[part][:, openings])
        complete = bool(record.dt[part].sum() > period * (1.0 - 1e-6))
        found.append(CycleMeans(k + 1, complete, ports, ratio, float(outflow)))
    return found


def _spread(P: np.ndarray, Q: np.ndarray, weight: np.ndarray) -> PortMeans:
    return PortMeans(
        mean_P_mmHg=float(weight @ P),
        least_P_mmHg=float(P.min()),
        largest_P_mmHg=float(P.max()),
        mean_Q_ml_per_min=float(weight @ Q),
        least_Q_ml_per_min=float(Q.min()),
        largest_Q_ml_per_min=float(Q.max()),
    )


def inlet_of(record: StepHistory, names: Sequence[str]) -> Inlet:
    """The aortic pressure of a run.

    Args:
        record: of the run.
        names: of the ports of its model, in their order.
    """
    return Inlet(record.t, port_pressure(record, names, inlet_name(names)) / MMHG)


@dataclasses.dataclass(frozen=True)
class Waveforms:
    """Pressures and flow of the distal outlet over a run.

    Attributes:
        t_s: times [s].
        P_aorta_mmHg: pressure at the inlet.
        P_distal_mmHg: pressure at the outlet.
        Q_ml_per_min: flow through it.
    """

    t_s: Float[np.ndarray, " times"]
    P_aorta_mmHg: Float[np.ndarray, " times"]
    P_distal_mmHg: Float[np.ndarray, " times"]
    Q_ml_per_min: Float[np.ndarray, " times"]


def waveforms(record: StepHistory, names: Sequence[str], distal: str, most: int) -> Waveforms:
    """Pressures and flow of an outlet over a run, thinned where there are many steps.

    Args:
        record: of the run.
        names: of the ports of its model, in their order.
        distal: name of the outlet.
        most: samples at most.

    Raises:
        ValueError: no port is an inlet.
    """
    some = slice(None, None, max(1, -(-record.n_steps // most)))
    columns = (
        record.t,
        port_pressure(record, names, inlet_name(names)) / MMHG,
        port_pressure(record, names, distal) / MMHG,
        port_flow(record, names, distal) / ML_PER_MIN,
    )
    return Waveforms(*(values[some] for values in columns))
