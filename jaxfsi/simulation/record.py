"""What happened at every step of a run: times, ports, effort, quality.

Columns of the CSV file: step (in whole steps), t_s, dt_s, P_NAME_mmHg and Q_NAME_ml_per_min for
each port, n_linear, n_nonlinear, residual, least_volume, change. Q > 0 leaves the domain.
"""

import pathlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lumped.units import ML_PER_MIN, MMHG
from lumped.whole_files import write_whole


class StepHistory(NamedTuple):
    """All steps of a run.

    Attributes:
        step: time at the end of the step, in steps of full length.
        t: time at its end [s].
        dt: its length [s].
        P_port: mean pressure of each port [dyn/cm²].
        Q_port: flow out of each port [cm³/s].
        n_gmres: iterations of GMRES.
        n_newton: linear systems solved.
        residual: weighted residual at the end over that of the extrapolated state.
        min_volume_ratio: smallest volume of a fluid element over its reference volume.
        change: see `jaxfsi.simulation.chunk`.
    """

    step: Float[np.ndarray, " steps"]
    t: Float[np.ndarray, " steps"]
    dt: Float[np.ndarray, " steps"]
    P_port: Float[np.ndarray, "steps ports"]
    Q_port: Float[np.ndarray, "steps ports"]
    n_gmres: Int[np.ndarray, " steps"]
    n_newton: Int[np.ndarray, " steps"]
    residual: Float[np.ndarray, " steps"]
    min_volume_ratio: Float[np.ndarray, " steps"]
    change: Float[np.ndarray, " steps"]

    @property
    def n_steps(self) -> int:
        """Number of steps taken, of whatever length."""
        return len(self.t)


def empty_record(n_ports: int) -> StepHistory:
    """A record without steps."""
    rows, counts = np.zeros(0), np.zeros(0, np.int64)
    ports = np.zeros((0, n_ports))
    return StepHistory(rows, rows, rows, ports, ports, counts, counts, rows, rows, rows)


def joined(records: list[StepHistory]) -> StepHistory:
    """Records of consecutive steps as one."""
    if len(records) == 1:
        return records[0]
    return StepHistory(*(np.concatenate(parts) for parts in zip(*records, strict=True)))


def mean_over(record: StepHistory, t_from: float) -> tuple[np.ndarray, np.ndarray]:
    """Means of pressure [dyn/cm²] and flow [cm³/s] of each port since a time, steps by length."""
    late = record.t > t_from + 0.5 * float(np.min(record.dt, initial=np.inf))
    weight = record.dt[late] / np.sum(record.dt[late])
    return weight @ record.P_port[late], weight @ record.Q_port[late]


def port_pressure(
    record: StepHistory, names: Sequence[str], name: str
) -> Float[np.ndarray, " steps"]:
    """Mean pressure of one port at each step [dyn/cm²].

    Args:
        record: of a run.
        names: of the ports of its model, in their order.
        name: of the port.
    """
    return record.P_port[:, names.index(name)]


def port_flow(record: StepHistory, names: Sequence[str], name: str) -> Float[np.ndarray, " steps"]:
    """Flow out of one port at each step [cm³/s]; see `port_pressure`."""
    return record.Q_port[:, names.index(name)]


def columns(names: tuple[str, ...]) -> list[str]:
    """Names of the columns of the CSV file."""
    ports = [f"P_{name}_mmHg" for name in names] + [f"Q_{name}_ml_per_min" for name in names]
    return [
        *("step", "t_s", "dt_s"),
        *ports,
        *("n_linear", "n_nonlinear", "residual", "least_volume", "change"),
    ]


def write_csv(path: pathlib.Path, record: StepHistory, names: tuple[str, ...]) -> None:
    """Write the record of a run; an old file is replaced as a whole."""
    table = np.column_stack(
        [
            *(record.step, record.t, record.dt),
            *(record.P_port / MMHG).T,
            *(record.Q_port / ML_PER_MIN).T,
            *(record.n_gmres, record.n_newton, record.residual),
            *(record.min_volume_ratio, record.change),
        ]
    )
    rows = [",".join(f"{value:.12g}" for value in row) for row in table.tolist()]
    write_whole(path, "\n".join([",".join(columns(names)), *rows]) + "\n")
