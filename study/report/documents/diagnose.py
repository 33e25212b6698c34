"""The document of the command `diagnose`, `diagnosis.json`."""

import dataclasses

from study.report.documents.least_change import LumenPart
from study.report.documents.parts import NextMeasurement
from study.run.gap_parts import GapIn3D
from study.store.json_form import ABSENT, Absent
from study.store.provenance import Provenance


@dataclasses.dataclass(frozen=True)
class EffectEntry:
    """An effect of the catalogue and how it fits the record.

    Attributes:
        id: its name.
        place: where it acts.
        size: its size in the most probable hypothesis that holds it [`unit`].
        sd: its standard deviation [`unit`].
        unit: of both; `-` where there is none.
        equation: what it changes in the model.
        sentence: what it is, with its size, in words.
        settled_by: the measurement that would settle it.
        log_bayes_factor: ln of its evidence over that of the base model [-].
        score_scan: the same by the score scan, from one Jacobian [-].
        forms: probabilities of its equations [-], where it has several; `first` is the first.
        visibility: detectability λ of a usual size in this record [-]: below 3 it does not show.
    """

    id: str
    place: str
    size: float
    sd: float
    unit: str
    equation: str
    sentence: str
    settled_by: str
    log_bayes_factor: float
    score_scan: float
    forms: dict[str, float] | Absent = ABSENT
    visibility: float | Absent = ABSENT


@dataclasses.dataclass(frozen=True)
class PredictedGain:
    """Gain of the most probable hypothesis over no gap in ln predictive density.

    Attributes:
        held_out: of the held-out conditions given the fitted ones; None where there are none.
        left_out: of each fitted condition given the other fitted ones, by its name.
        confirmed: whether it predicts what was left out no worse than no gap does.
    """

    held_out: float | None
    left_out: dict[str, float]
    confirmed: bool


@dataclasses.dataclass(frozen=True)
class DataBlock:
    """A part of the data that disagrees with the base model.

    Attributes:
        condition: name of the condition.
        site: sensor, or the ratio.
        phase: part of the beat.
        excess: (χ² − n)/n of its n data [-].
        z: (χ² − n)/√(2n) [-].
        global_p: chance that noise alone gives as large a z anywhere on the map [-].
    """

    condition: str
    site: str
    phase: str
    excess: float
    z: float
    global_p: float


@dataclasses.dataclass(frozen=True)
class BeforeAfter:
    """A misfit, in the unit of its key.

    Attributes:
        before: of the base model.
        after: with the most probable hypothesis.
        noise_floor: what noise alone leaves.
    """

    before: float
    after: float
    noise_floor: float


@dataclasses.dataclass(frozen=True)
class HeldOutGap:
    """Errors on a condition that was held out.

    Attributes:
        condition: name of the condition.
        P_distal_rms_mmHg: root mean square of what the model misses of the distal pressure; None
            without a waveform.
        ffr_error: error of the pressure ratio [-]; None where it was not measured.
    """

    condition: str
    P_distal_rms_mmHg: BeforeAfter | None
    ffr_error: BeforeAfter | None


@dataclasses.dataclass(frozen=True)
class Gap:
    """How far the gap between model and data shrinks.

    Attributes:
        fitted: excess misfit χ²/n − 1 of the data that were fitted [-].
        held_out: on each condition that was held out.
    """

    fitted: BeforeAfter
    held_out: list[HeldOutGap]


@dataclasses.dataclass(frozen=True)
class NoiseLevel:
    """Noise of the record.

    Attributes:
        pressure_sd_mmHg: standard deviation of a sample of the mean beat of a pressure.
        offset_sd_mmHg: standard deviation of the slow offset of a trace.
        white_share: share of white noise in the variance [-].
        origin: `stated`, `estimated` or `assumed`.
    """

    pressure_sd_mmHg: float
    offset_sd_mmHg: float
    white_share: float
    origin: str


@dataclasses.dataclass(frozen=True)
class TraceModels:
    """A trace as measured and as modelled: pressures [mmHg], flows `Q` [mL/s].

    Attributes:
        measured: as measured; None where it was not.
        before: of the base model.
        after: with the most probable hypothesis.
    """

    measured: list[float] | None
    before: list[float]
    after: list[float]


@dataclasses.dataclass(frozen=True)
class RecordWaveforms:
    """Traces of a condition over a beat.

    Attributes:
        condition: name of the condition.
        held_out: whether it was held out of the fit.
        t_s: times from the start of the beat.
        traces: by name of the sensor: pressures [mmHg], flows `Q` [mL/s].
    """

    condition: str
    held_out: bool
    t_s: list[float]
    traces: dict[str, TraceModels]


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiagnoseDocument:
    """Why a record and its calibrated model differ.

    Attributes:
        kind: `diagnose`.
        format: name and version of the layout.
        id: id of the record.
        verdict: `no_gap`, `named`, `ambiguous` or `unknown`, see `diagnosis.verdict`.
        sentence: the result in a sentence.
        to_do: what to do next.
        named: the named effects, the ambiguous set, or the nearest effect.
        probabilities: of each hypothesis [-]; effects together are joined by `+`.
        inclusion: probability that an effect acts, alone or with others [-].
        closed: whether the most probable hypothesis closes the gap.
        other_bed: probability that the bed of the muscle has another structure than the model's one
            layer, with that hypothesis [-]; absent without waveforms.
        effects: the likeliest effects.
        where: parts of the data that disagree, given all conditions.
        where_after_rest_alone: the same with the base model calibrated at rest; None without.
        place_in_model: probability that a cause acts at each place [-].
        free_forcing: share of the evidence of a free forcing at each place [-].
        unknown_beside: probability of an unknown cause beside each hypothesis [-].
        smallest_global_p: least `global_p` that the number of draws can tell [-].
        gap: how far the gap shrinks.
        predicted: how conditions that were left out are predicted; left out without waveforms.
        aliases: pairs of effects that the data do not tell apart.
        next_measurements: measurements that would tell the likeliest causes apart, best first.
        noise: of the record.
        remarks: what the record lacks.
        provenance: inputs, options, versions.
        waveforms: traces by condition.
        lumen: whether another lumen than that of the study explains the record; left out without
            a finished study.
        no_lumen: why `lumen` is left out.
        in_3d: the gap in the FSI model; left out where it was not asked for.
    """

    kind: str
    format: str
    id: str
    verdict: str
    sentence: str
    to_do: list[str] | Absent = ABSENT
    named: list[str]
    probabilities: dict[str, float]
    inclusion: dict[str, float]
    closed: bool
    other_bed: float | Absent = ABSENT
    effects: list[EffectEntry]
    where: list[DataBlock]
    where_after_rest_alone: list[DataBlock] | None
    place_in_model: dict[str, float]
    free_forcing: dict[str, float]
    unknown_beside: dict[str, float]
    smallest_global_p: float
    gap: Gap
    predicted: PredictedGain | Absent = ABSENT
    aliases: list[list[str]]
    next_measurements: list[NextMeasurement]
    noise: NoiseLevel
    remarks: list[str]
    provenance: Provenance
    waveforms: list[RecordWaveforms]
    lumen: LumenPart | Absent = ABSENT
    no_lumen: str | Absent = ABSENT
    in_3d: GapIn3D | Absent = ABSENT
