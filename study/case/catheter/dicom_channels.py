"""Channels of a DICOM file of haemodynamic waveforms (PS3.3 C.10.9), by pydicom.

A file holds multiplex groups, each sampled at one rate, and a group holds channels. An encoded
sample n of a channel means

    value = n · sensitivity · correction factor + baseline       [unit of the sensitivity]

at the time, in s,

    t_k = group offset + channel skew + channel offset + k/rate.

Nothing that names the patient is read: of the file's own elements only the kind of the object and
the waveforms are, not even the rest of its header.
"""

import dataclasses
import importlib.util
import io
import math
import pathlib
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxfsi.text_files import regular_bytes
from study.case.catheter.table import LARGEST_SIZE, refusal
from study.case.faults import CaseError, unreadable

if TYPE_CHECKING:
    from pydicom.dataset import Dataset

SOP_CLASS = "1.2.840.10008.5.1.4.1.1.9.2.1"
"""Hemodynamic Waveform Storage."""

_SUFFIXES = (".dcm", ".dicom")
_MARK, _MARK_AT = b"DICM", 128
_DEFLATED = "1.2.840.10008.1.2.1.99"
_TYPES = {"SB": "i1", "UB": "u1", "SS": "i2", "US": "u2", "SL": "i4", "UL": "u4"}
_UNITS = {
    "mm[hg]": "mmHg", "mmhg": "mmHg", "kpa": "kPa", "ml/min": "ml/min", "ml/(min)": "ml/min",
}  # fmt: skip
_AORTIC_CODES = frozenset(
    ("128444004", "G-DB22", "15825003", "T-42000", "54247002", "T-42100", "8128003")
)
"""Aortic pressure waveform, aorta, ascending aorta, aortic root: SNOMED CT and, before it, RT."""

_DISTAL_CODES = frozenset(("41879009", "T-43202", "36672000", "6511003"))
"""Distal right, left anterior descending and circumflex coronary artery."""

_LONGEST_NAME = 60
_AGAIN = "export it again; else export the traces as text"


@dataclasses.dataclass(frozen=True)
class Channel:
    """One channel.

    Attributes:
        name: its label, else its coded source.
        role: `aortic` or `distal` where its coded source says so; else an empty text.
        code: unit as the file writes it, by UCUM; empty where it says none.
        rate: samples a second [1/s].
        start: time of the first sample, from the reference of the file [s].
        shift: skew and offset of the channel within its group, part of `start` [s].
        values: samples in that unit; NaN: padding.
        problem: why the values mean nothing, a clause; empty where they do.
        remarks: what is unusual of it, in sentences.
    """

    name: str
    role: str
    code: str
    rate: float
    start: float
    shift: float
    values: np.ndarray
    problem: str
    remarks: tuple[str, ...]

    @property
    def unit(self) -> str:
        """Unit as exports write it; empty where it is no known one."""
        return _UNITS.get(self.code.lower(), "")


def is_dicom(path: pathlib.Path) -> bool:
    """Whether a file says that it is DICOM, by its mark or by its name."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            marked = file.read(_MARK_AT + len(_MARK))[_MARK_AT:] == _MARK
    except OSError:
        return False
    return marked or path.suffix.lower() in _SUFFIXES


def read_channels(path: pathlib.Path) -> list[Channel]:
    """Read the channels of a file, those of all groups one after the other.

    Args:
        path: the file.

    Raises:
        CaseError: pydicom is missing, or it is no file of haemodynamic waveforms, or is damaged.
    """
    if importlib.util.find_spec("pydicom") is None:
        cure = "pip install 'jaxfsi[dicom]', or export the traces as text"
        raise refusal(path, "DICOM files need the package pydicom, which is not installed", cure)
    groups, little = _groups(path)
    channels: list[Channel] = []
    for group in groups:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                channels += _channels(group, little)
        except _Damaged as error:
            raise refusal(path, str(error), _AGAIN) from None
        except Exception:  # pydicom reads an element when asked: a damaged one may raise anything
            raise refusal(path, "its waveforms are damaged", _AGAIN) from None
    if not channels:
        raise refusal(path, "it holds no waveform", _AGAIN)
    return channels


class _Damaged(ValueError):
    """What of a file does not fit together, in words for its user."""


def _groups(path: pathlib.Path) -> tuple[list["Dataset"], bool]:
    """Multiplex groups of a file, and whether its samples are little-endian."""
    content = _content(path)
    import pydicom
    import pydicom.filereader
    import pydicom.uid

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            meta = pydicom.filereader.read_file_meta_info(path)
            if str(meta.get("TransferSyntaxUID", "")) == _DEFLATED:
                problem = "its content is packed (deflated transfer syntax)"
                raise refusal(path, problem, "export it again without compression")
            tags = ["SOPClassUID", "WaveformSequence"]
            read = pydicom.dcmread(io.BytesIO(content), specific_tags=tags)
            kind = str(read.get("SOPClassUID") or meta.get("MediaStorageSOPClassUID", ""))
            name = pydicom.uid.UID(kind).name.removesuffix(" Storage") if kind else ""
            groups = list(read.get("WaveformSequence") or [])
            little = read.original_encoding[1] is not False
    except CaseError:
        raise
    except Exception:  # the parser raises whatever comes of damaged bytes
        raise refusal(path, "the DICOM file is damaged or breaks off", _AGAIN) from None
    if kind != SOP_CLASS:
        problem = f"it is {name or 'of no stated kind'}, not Hemodynamic Waveform"
        cure = "give the object with the pressures; else export them as text"
        raise refusal(path, problem, cure)
    if not groups:
        raise refusal(path, "it holds no waveform, or breaks off before it", _AGAIN)
    return groups, little


def _content(path: pathlib.Path) -> bytes:
    try:
        if path.stat().st_size > LARGEST_SIZE:
            problem = f"larger than a recording ({LARGEST_SIZE // 2**20} MiB)"
            raise refusal(path, problem, "export the minutes of one condition")
        content = regular_bytes(path)
    except OSError as error:
        raise refusal(path, unreadable(error), "give a file that can be read") from None
    if content[_MARK_AT : _MARK_AT + len(_MARK)] != _MARK:
        cure = "give a DICOM file, or rename an export as text to .csv"
        raise refusal(path, "this is no DICOM file: its mark DICM is missing", cure)
    return content


def _channels(group: "Dataset", little: bool) -> list[Channel]:
    """Channels of a group."""
    definitions = list(group.get("ChannelDefinitionSequence") or [])
    count, length = int(group.NumberOfWaveformChannels), int(group.NumberOfWaveformSamples)
    rate = _number(group, "SamplingFrequency")
    if rate is None or rate <= 0.0:
        raise _Damaged("a group of its channels has no sampling frequency (003A,001A)")
    if len(definitions) != count or count < 1 or length < 1:
        raise _Damaged(f"{count} channels are announced and {len(definitions)} described")
    encoded, padding = _samples(group, count, length, little)
    start = 1e-3 * (_number(group, "MultiplexGroupTimeOffset") or 0.0)
    return [
        _channel(definition, None if encoded is None else encoded[:, k], padding, rate, start)
        for k, definition in enumerate(definitions)
    ]


def _samples(
    group: "Dataset", count: int, length: int, little: bool
) -> tuple[np.ndarray | None, int | None]:
    """Encoded samples, samples × channels, and the number that stands for none; None: not read."""
    data = bytes(group.get("WaveformData") or b"")
    if not data:
        raise _Damaged("it breaks off before the samples of a channel")
    form = _TYPES.get(str(group.get("WaveformSampleInterpretation", "")))
    if form is None:
        return None, None
    kind = np.dtype(form).newbyteorder("<" if little else ">")
    if int(group.get("WaveformBitsAllocated", 8 * kind.itemsize)) != 8 * kind.itemsize:
        raise _Damaged("the width of its samples contradicts their type (5400,1004)")
    needed = count * length * kind.itemsize
    if len(data) < needed:
        had = len(data) // (count * kind.itemsize)
        raise _Damaged(f"it breaks off: {had} of {length} samples are there")
    encoded = np.frombuffer(data[:needed], kind).reshape(length, count)
    stated: Any = group.get("WaveformPaddingValue")
    if isinstance(stated, bytes):
        whole = len(stated) >= kind.itemsize
        stated = int(np.frombuffer(stated[: kind.itemsize], kind)[0]) if whole else None
    return encoded, None if stated is None else int(stated)


def _channel(
    item: "Dataset", encoded: np.ndarray | None, padding: int | None, rate: float, start: float
) -> Channel:
    sources = [*(item.get("ChannelSourceSequence") or [])]
    source = [*sources, *(item.get("ChannelSourceModifiersSequence") or [])]
    meanings = [text for text in (_plain(s.get("CodeMeaning")) for s in source) if text]
    name = _plain(item.get("ChannelLabel")) or ", ".join(meanings) or "?"
    units = item.get("ChannelSensitivityUnitsSequence") or []
    code = _plain(units[0].get("CodeValue")) if units else ""
    skew = _number(item, "ChannelTimeSkew")
    if skew is None:
        skew = (_number(item, "ChannelSampleSkew") or 0.0) / rate
    shift = skew + (_number(item, "ChannelOffset") or 0.0)
    values, problem, remarks = _scaled(item, encoded, padding, name)
    status = [word for word in _words(item.get("ChannelStatus")) if word != "OK"]
    if status:
        remarks.append(f"The file calls {name} {', '.join(status)}.")
    role = _role([_plain(s.get("CodeValue")) for s in source], meanings)
    return Channel(
        name, role, code, rate, start + shift, shift, values, problem, tuple(remarks)
    )  # fmt: skip


def _scaled(
    item: "Dataset", encoded: np.ndarray | None, padding: int | None, name: str
) -> tuple[np.ndarray, str, list[str]]:
    """Values in the channel's unit, why they mean nothing, and remarks."""
    if encoded is None:
        return np.zeros(0), "its samples are not linear numbers (5400,1006)", []
    sensitivity = _number(item, "ChannelSensitivity")
    if not sensitivity:
        problem = "it has no sensitivity (003A,0210), so its numbers have no unit"
        return np.zeros(0), problem, []
    correction = _number(item, "ChannelSensitivityCorrectionFactor")
    baseline = _number(item, "ChannelBaseline")
    lacking = [
        said
        for value, said in ((correction, "correction factor: 1"), (baseline, "baseline: 0"))
        if value is None
    ]
    remarks = [f"{name} has no {said} is taken." for said in lacking]
    scale = sensitivity * (1.0 if correction is None else correction)
    values = encoded * scale + (baseline or 0.0)
    if padding is not None:
        values[encoded == padding] = np.nan
    return values, "", remarks


def _role(codes: list[str], meanings: list[str]) -> str:
    """What a coded source says that a channel is."""
    words = {word for text in meanings for word in text.lower().replace(",", " ").split()}
    aortic = not _AORTIC_CODES.isdisjoint(codes) or bool(words & {"aorta", "aortic"})
    distal = not _DISTAL_CODES.isdisjoint(codes) or "distal" in words
    if aortic == distal or words & {"mean", "flow", "velocity", "valve"}:
        return ""
    return "aortic" if aortic else "distal"


def _number(item: "Dataset", keyword: str) -> float | None:
    """A finite number, or None where there is none."""
    value = item.get(keyword)
    if value is None or value == "":
        return None
    number = float(value)
    if not math.isfinite(number):
        raise _Damaged(f"{keyword} is no finite number")
    return number


def _words(value: Any) -> list[str]:
    many = [value] if value is None or isinstance(value, str) else list(value)
    return [text for text in map(_plain, many) if text]


def _plain(value: Any) -> str:
    """A text of the file on one line, without control characters."""
    text = "" if value is None else str(value)
    clean = "".join(c if c.isprintable() else " " for c in text)
    return " ".join(clean.split())[:_LONGEST_NAME]
