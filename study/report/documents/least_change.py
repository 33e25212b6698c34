"""Whether boundary parameters or another lumen reach a record, as `diagnosis.json` holds it."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class BoundaryReach:
    """Whether boundary parameters alone reach a record.

    Attributes:
        reached: whether they do.
        p_value: chance that noise leaves the misfit of the base model [-].
        R0_pull_sd: how far R0 has to lie from that of the study, in its standard deviations.
    """

    reached: bool
    p_value: float
    R0_pull_sd: float


@dataclasses.dataclass(frozen=True)
class WantedLoss:
    """The loss of the artery that the record wants.

    Attributes:
        factor: on that of the study [-].
        log_sd: standard deviation of its logarithm.
        flow_ml_per_min: mean flow at which it is wanted.
        effects: what else was fitted beside it.
        explains: whether it closes the gap.
        p_value: chance that noise leaves the misfit that is left [-].
    """

    factor: float
    log_sd: float
    flow_ml_per_min: float
    effects: list[str]
    explains: bool
    p_value: float


@dataclasses.dataclass(frozen=True)
class LeastLumenChange:
    """The least change of the lumen whose loss is the wanted one.

    Attributes:
        s_mm: distance of each section from the ostium.
        half_minor_mm: half of its minor axis as scanned; its radius where it is round.
        radius_mm: radius of the circle of its area as scanned.
        delta_r_mm: change of its half-axes.
        low_mm: least of the changes with this loss and two standard deviations off either way.
        high_mm: largest of the same.
        largest_mm: largest change, negative where it narrows.
        largest_s_mm: where.
        from_mm: where the change begins that is at least half of it.
        to_mm: where it ends.
        course_mm: length of the intramural course; None where nothing tells.
        course_mean_mm: mean change over it; None likewise.
        scan: of what `scan_sd_mm` is: `ultrasound`, `CT` or `the case`.
        scan_sd_mm: standard deviation of the half-axes as scanned.
        correlation_mm: length over which errors of the scan are alike.
        n_sd: standard deviations of the scan that the whole change takes.
        R0_factor: factor on the resistance of the lumen at zero flow [-].
        K_factor: factor on its quadratic coefficient [-].
    """

    s_mm: list[float]
    half_minor_mm: list[float]
    radius_mm: list[float]
    delta_r_mm: list[float]
    low_mm: list[float]
    high_mm: list[float]
    largest_mm: float
    largest_s_mm: float
    from_mm: float
    to_mm: float
    course_mm: float | None
    course_mean_mm: float | None
    scan: str
    scan_sd_mm: float
    correlation_mm: float
    n_sd: float
    R0_factor: float
    K_factor: float


@dataclasses.dataclass(frozen=True)
class LumenPart:
    """Whether the record is reached by boundary parameters, or by another lumen.

    Attributes:
        study: whose lumen it is.
        sentence: the result in words.
        boundary: by boundary parameters alone.
        wanted: the loss of the artery that the record wants.
        change: the least change of the lumen with that loss; None where none is needed, or none
            would help.
    """

    study: str
    sentence: str
    boundary: BoundaryReach
    wanted: WantedLoss
    change: LeastLumenChange | None
