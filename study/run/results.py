"""Runs of a study in 3D: which one, and what it found, as documents and stages hold it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from jaxfsi.opening import is_anomalous
from jaxfsi.simulation.cycles import CycleMeans, PortMeans
from study.store.json_form import ABSENT, Absent, from_json
from study.store.result_names import LOOP


@dataclasses.dataclass(frozen=True)
class RunId:
    """Which run of a study.

    Attributes:
        label: what its α comes from; of a correction with its number.
        condition: name of the condition.
        rule: stress rule; None at rest.
    """

    label: str
    condition: str
    rule: str | None = None

    @property
    def name(self) -> str:
        """The id as text, which is the name of its folder."""
        return "-".join(part for part in (self.label, self.condition, self.rule) if part)


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """A run to be made.

    Attributes:
        id: which one.
        alpha: scale of the resistances of the anomalous outlet [-].
    """

    id: RunId
    alpha: float


@dataclasses.dataclass(frozen=True)
class RunCycle(CycleMeans):
    """A cycle of a run of a study.

    Attributes:
        site_offset_mmHg: mean pressure at the ostium over that at the inlet of the aorta.
        ratio_to_inlet: ratio to the pressure at the inlet, where `ratio` is that to the ostium.
    """

    site_offset_mmHg: float | Absent = ABSENT
    ratio_to_inlet: float | Absent | None = ABSENT

    @property
    def site_offset(self) -> float:
        """`site_offset_mmHg`, 0 where the pressure at the ostium was not read."""
        offset = self.site_offset_mmHg
        return 0.0 if isinstance(offset, Absent) else offset

    def at_site(self, offset: float, inlet: str) -> "RunCycle":
        """The cycle with its ratio taken to the aortic pressure at the ostium.

        Args:
            offset: mean pressure at the ostium over that at the inlet [mmHg].
            inlet: name of the inlet.
        """
        P = self.ports[inlet].mean_P_mmHg
        ratio = None if self.ratio is None else self.ratio * P / (P + offset)
        return dataclasses.replace(
            self, ratio=ratio, site_offset_mmHg=offset, ratio_to_inlet=self.ratio
        )


@dataclasses.dataclass(frozen=True)
class RunHistory:
    """Pressures and flow of a run over time.

    Attributes:
        t_s: times.
        P_aorta_mmHg: pressure at the inlet of the aorta.
        P_distal_mmHg: pressure at the anomalous outlet.
        Q_ml_per_min: flow through it.
        t_site_s: times of the frames.
        P_site_mmHg: pressure at the ostium in each frame.
    """

    t_s: list[float]
    P_aorta_mmHg: list[float]
    P_distal_mmHg: list[float]
    Q_ml_per_min: list[float]
    t_site_s: list[float] | Absent = ABSENT
    P_site_mmHg: list[float] | Absent = ABSENT

    @property
    def has_site(self) -> bool:
        """Whether the pressure at the ostium was read."""
        return self.P_site_mmHg is not ABSENT


@dataclasses.dataclass(frozen=True)
class Run3D:
    """A run in 3D.

    Attributes:
        id: which run.
        label: what its α comes from.
        condition: name of the condition.
        rule: stress rule; None at rest.
        alpha: scale of the resistances of the anomalous outlet [-].
        ratio: mean distal over mean aortic pressure of the last whole cycle [-].
        ratios: of every whole cycle [-].
        ratio_change: change over the last two whole cycles [-]; None with one.
        drift_mmHg: largest change of a state of the anomalous bed over the run.
        cycles: its cycles, parts of one among them.
        period_s: length of a cycle.
        dt_s: length of a step.
        steps: number of steps.
        repeated: steps that failed and were repeated with smaller ones.
        mean_iterations: iterations of GMRES of a step.
        least_volume: smallest volume of a fluid element over its reference volume [-].
        folder: of its fields, below that of the study.
        history: pressures and flow over time.
    """

    id: str
    label: str
    condition: str
    rule: str | None
    alpha: float
    ratio: float | None
    ratios: list[float | None]
    ratio_change: float | None
    drift_mmHg: float | None
    cycles: list[RunCycle]
    period_s: float
    dt_s: float
    steps: int
    repeated: int
    mean_iterations: float
    least_volume: float
    folder: str
    history: RunHistory

    @property
    def planned(self) -> PlannedRun:
        """The run as it was planned."""
        return PlannedRun(RunId(self.label, self.condition, self.rule), self.alpha)

    @property
    def is_rest(self) -> bool:
        """Whether it is a run at rest."""
        return self.condition == "rest"

    @property
    def distal(self) -> PortMeans:
        """The anomalous outlet over the last cycle."""
        ports = self.cycles[-1].ports
        return next(ports[name] for name in ports if is_anomalous(name))


def stored_run(stored: Mapping[str, Any], run: PlannedRun) -> Run3D:
    """A run from what a stage holds of it; older stages do not say its id.

    Raises:
        ValueError: a part of it is missing or of another type.
    """
    return from_json(Run3D, {"id": run.id.name, **stored})


def calibrated_runs(runs: Sequence[Run3D], rest: str) -> list[Run3D]:
    """Runs with α as calibrated, rest first.

    Args:
        runs: all runs of a study.
        rest: id of the one at rest that the calibration chose.
    """
    return [r for r in runs if r.id == rest] + [
        r for r in runs if not r.is_rest and r.label == LOOP
    ]
