"""DICOM files of haemodynamic waveforms as archives hold them, written by pydicom."""

import pathlib
from typing import NamedTuple

import numpy as np
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, generate_uid

HEMODYNAMIC = "1.2.840.10008.5.1.4.1.1.9.2.1"
PATIENT = "Zweistein^Frieda"


class Wave(NamedTuple):
    """A channel, and how it is encoded.

    Attributes:
        label: of the channel; empty: none.
        samples: values in its unit.
        unit: UCUM code; None: no unit, no sensitivity.
        source: code value and meaning of its source.
        modifiers: meanings of the source's modifiers.
        sensitivity: of a step of the encoding; None: not written.
        correction: factor of the sensitivity; None: not written.
        baseline: value of the encoded 0; None: not written.
        skew: time of the first sample within its group [s].
        sample_skew: the same in samples, instead.
        offset: a further one [s].
        status: words of its status.
    """

    label: str
    samples: np.ndarray
    unit: str | None = "mm[Hg]"
    source: tuple[str, str] = ("128433007", "Hemodynamic pressure waveform")
    modifiers: tuple[str, ...] = ()
    sensitivity: float | None = 0.05
    correction: float | None = 1.0
    baseline: float | None = 0.0
    skew: float | None = 0.0
    sample_skew: float | None = None
    offset: float | None = None
    status: str | None = None


class Group(NamedTuple):
    """A multiplex group: channels that were sampled together.

    Attributes:
        waves: its channels.
        rate: samples a second; None: not written.
        offset: time of its start [ms].
        padding: encoded number of the samples that are NaN.
    """

    waves: tuple[Wave, ...]
    rate: float | None = 100.0
    offset: float | None = None
    padding: int = -32768


def encoded(wave: Wave, padding: int = -32768) -> np.ndarray:
    """Samples of a channel as integers."""
    step = (wave.sensitivity or 1.0) * (1.0 if wave.correction is None else wave.correction)
    counts = np.round((wave.samples - (wave.baseline or 0.0)) / step)
    return np.where(np.isnan(counts), padding, counts).astype("<i2")


def decoded(wave: Wave) -> np.ndarray:
    """Samples of a channel after their quantisation, in its unit."""
    step = (wave.sensitivity or 1.0) * (1.0 if wave.correction is None else wave.correction)
    return encoded(wave) * step + (wave.baseline or 0.0)


def _code(value: str, meaning: str, scheme: str) -> list[Dataset]:
    code = Dataset()
    code.CodeValue, code.CodeMeaning, code.CodingSchemeDesignator = value, meaning, scheme
    return [code]


def _definition(wave: Wave) -> Dataset:
    item = Dataset()
    if wave.label:
        item.ChannelLabel = wave.label
    item.ChannelSourceSequence = _code(*wave.source, "SCT")
    if wave.modifiers:
        item.ChannelSourceModifiersSequence = [
            _code("0", meaning, "99TEST")[0] for meaning in wave.modifiers
        ]
    for keyword, value in (
        ("ChannelSensitivity", wave.sensitivity),
        ("ChannelSensitivityCorrectionFactor", wave.correction),
        ("ChannelBaseline", wave.baseline),
        ("ChannelTimeSkew", wave.skew),
        ("ChannelSampleSkew", wave.sample_skew),
        ("ChannelOffset", wave.offset),
        ("ChannelStatus", wave.status),
    ):
        if value is not None:
            setattr(item, keyword, value)
    if wave.unit is not None:
        item.ChannelSensitivityUnitsSequence = _code(wave.unit, wave.unit, "UCUM")
    item.WaveformBitsStored = 16
    return item


def _group(group: Group) -> Dataset:
    item = Dataset()
    item.WaveformOriginality = "ORIGINAL"
    item.NumberOfWaveformChannels = len(group.waves)
    item.NumberOfWaveformSamples = group.waves[0].samples.size
    if group.rate is not None:
        item.SamplingFrequency = group.rate
    if group.offset is not None:
        item.MultiplexGroupTimeOffset = group.offset
    item.ChannelDefinitionSequence = [_definition(wave) for wave in group.waves]
    item.WaveformBitsAllocated = 16
    item.WaveformSampleInterpretation = "SS"
    counts = np.stack([encoded(wave, group.padding) for wave in group.waves], axis=1)
    item.add_new(0x5400100A, "OW", np.array(group.padding, "<i2").tobytes())
    item.add_new(0x54001010, "OW", counts.tobytes())
    return item


def waveform_file(*groups: Group, sop_class: str = HEMODYNAMIC) -> FileDataset:
    """A file of these groups, of a patient with name, number and date of birth."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = sop_class
    meta.MediaStorageSOPInstanceUID = generate_uid()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    made = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
    made.SOPClassUID, made.SOPInstanceUID = sop_class, meta.MediaStorageSOPInstanceUID
    made.Modality = "HD"
    made.PatientName, made.PatientID, made.PatientBirthDate = PATIENT, "4711-0815", "20101224"
    made.StudyDate, made.ReferringPhysicianName = "20261101", "Curie^Marie"
    made.WaveformSequence = [_group(group) for group in groups]
    return made


def write_waveforms(path: pathlib.Path, *groups: Group, sop_class: str = HEMODYNAMIC) -> None:
    """Write such a file."""
    waveform_file(*groups, sop_class=sop_class).save_as(path, enforce_file_format=True)
