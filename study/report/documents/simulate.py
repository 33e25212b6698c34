"""The document of the command `simulate`, `simulation.json`."""

import dataclasses

from jaxfsi.simulation.cycles import CycleMeans
from study.report.documents.parts import BodyNumbers, Note
from study.store.json_form import ABSENT, Absent
from study.store.provenance import Provenance

PortNumbers = dict[str, float | str]


@dataclasses.dataclass(frozen=True)
class ShearNumbers:
    """Wall shear stress over the last cycle.

    Attributes:
        mean_tawss_dyn_per_cm2: time average, mean over the surface of the lumen.
        p99_tawss_dyn_per_cm2: a hundredth of that surface exceeds it.
        mean_osi: oscillatory shear index, mean over that surface [-].
        duration_s: time over which the means are taken.
    """

    mean_tawss_dyn_per_cm2: float
    p99_tawss_dyn_per_cm2: float
    mean_osi: float
    duration_s: float


@dataclasses.dataclass(frozen=True)
class SimulatedMesh:
    """The mesh of a run.

    Attributes:
        nodes: number of nodes.
        tets: number of tetrahedra by region, `fluid` and `solid`.
        openings: names of the openings.
    """

    nodes: int
    tets: dict[str, int]
    openings: list[str]


@dataclasses.dataclass(frozen=True, kw_only=True)
class SolverNumbers:
    """What the march took.

    Attributes:
        dt_s: length of a whole step.
        steps_planned: whole steps asked for.
        steps_per_cycle: whole steps in a cycle.
        steps_done: whole steps done.
        steps_taken: steps taken, shorter ones counted each.
        resumed_from: whole step that the command went on from; None for a fresh run.
        seconds_per_step: wall time of a whole step; None where too few were taken to tell.
        seconds: wall time of the run, compiling included; older results do not say it.
        mean_iterations: iterations of GMRES of a step, mean.
        largest_iterations: largest number of them.
        largest_residual: largest relative residual at the end of a step [-].
        least_volume: smallest volume of a fluid element over its reference volume [-].
        tolerance: of the residual, relative [-].
        change_limit: largest change of the unknowns in a step; None: not limited.
    """

    dt_s: float
    steps_planned: int
    steps_per_cycle: int
    steps_done: int
    steps_taken: int
    resumed_from: float | None
    seconds_per_step: float | None
    seconds: float | Absent = ABSENT
    mean_iterations: float | None
    largest_iterations: int | None
    largest_residual: float | None
    least_volume: float | None
    tolerance: float
    change_limit: float | None


@dataclasses.dataclass(frozen=True)
class FailedStep:
    """A step that failed and was repeated with smaller ones.

    Attributes:
        step: whole steps done before it.
        t_s: time at its start.
        dt_s: its length.
        cause: why it failed.
    """

    step: float
    t_s: float
    dt_s: float
    cause: str


@dataclasses.dataclass(frozen=True)
class CollapseNumbers:
    """Where and when the lumen collapsed, which ended the run.

    Attributes:
        t_s: end of the last good step.
        point_mm: middle of the element of blood with the least part of its volume, deformed.
        from_ostium_mm: its distance from the ostium along the anomalous artery; None elsewhere.
        area_share: area of the lumen across the artery there over that of the image [-]; None
            where it is not known.
        volume_share: volume of that element over that in the image [-].
    """

    t_s: float
    point_mm: list[float]
    from_ostium_mm: float | None
    area_share: float | None
    volume_share: float


@dataclasses.dataclass(frozen=True)
class SimulatedHistory:
    """Pressures, flows and effort by step, or by every so-manieth where there are many.

    Attributes:
        ports: names of the openings.
        t_s: times at the end of the steps.
        dt_s: lengths of the steps.
        P_mmHg: mean pressure by opening.
        Q_ml_per_min: flow out of the domain by opening.
        n_linear: iterations of GMRES.
        residual: relative residual at the end [-].
        change: largest change of the unknowns [-].
        least_volume: smallest volume of a fluid element over its reference volume [-].
    """

    ports: list[str]
    t_s: list[float]
    dt_s: list[float]
    P_mmHg: dict[str, list[float]]
    Q_ml_per_min: dict[str, list[float]]
    n_linear: list[int]
    residual: list[float]
    change: list[float]
    least_volume: list[float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimulateDocument:
    """A run of blood and wall in 3D.

    Attributes:
        format: name and version of the layout.
        kind: `simulate`.
        patient: id of the patient.
        condition: name of the condition.
        rigid: whether the wall does not move.
        material: elastic law of the wall; None where it is rigid.
        wall_element: elements of the wall; None where it is rigid.
        ratio_name: `rest_ratio` at rest, else `ffr`.
        rest_ratio: at rest, mean distal over mean aortic pressure of the last whole cycle [-]; None
            without a whole cycle.
        ffr: the same in another condition [-].
        measured: measured ratio of the condition [-].
        failure: why the run ended early by a fault of the computation; None where it did not.
        collapse: where and when the lumen collapsed, which ended the run; absent where it did not.
        interrupted: whether the user ended it.
        notes: what looks wrong or needs care.
        period_s: length of a cycle.
        alpha: scale of the resistances of the anomalous outlet [-].
        alpha_origin: where it comes from, in words.
        ports: `kind` and numbers of each opening, in CGS.
        cycles: means of each cycle, parts of one among them.
        wall_shear: over the last cycle; None where it was not read.
        mesh: size of the mesh.
        solver: what the march took.
        events: steps that failed and were repeated.
        frames: number of frames in the folder `fields`.
        pictures: names of the pictures.
        picture_times_s: instants that they show.
        picture_note: why there are none; None where there are.
        sources: where the values of each table of the case come from.
        remarks: notes of the case, by table.
        provenance: inputs, options, versions.
        history: pressures, flows and effort over time.
        body: the body of the patient and what was assumed from it; absent where it is not known.
    """

    format: str
    kind: str
    patient: str
    condition: str
    rigid: bool
    material: str | None
    wall_element: str | None
    ratio_name: str
    rest_ratio: float | Absent | None = ABSENT
    ffr: float | Absent | None = ABSENT
    measured: float | None
    failure: str | None
    collapse: CollapseNumbers | Absent = ABSENT
    interrupted: bool
    notes: list[Note]
    period_s: float
    alpha: float
    alpha_origin: str
    ports: dict[str, PortNumbers]
    cycles: list[CycleMeans]
    wall_shear: ShearNumbers | None
    mesh: SimulatedMesh
    solver: SolverNumbers
    events: list[FailedStep]
    frames: int
    pictures: list[str]
    picture_times_s: list[float]
    picture_note: str | None
    sources: dict[str, str]
    remarks: dict[str, str]
    provenance: Provenance
    history: SimulatedHistory
    body: BodyNumbers | Absent = ABSENT
