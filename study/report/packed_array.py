"""Arrays as text inside a page: rounded to a quantum, as differences, deflated.

An array is ``low + quantum * n`` with whole numbers n ≥ 0, so that no value is off by more than
half a quantum. Of n its differences along the first axis are kept (from frame to frame of a cycle),
each folded to a whole number that is not negative (0, −1, 1, −2, ... become 0, 1, 2, 3, ...), its
bytes apart, lowest first, as many as the largest needs; zlib over all, base64. The page undoes this
with the browser's own ``DecompressionStream("deflate")``.
"""

import base64
import dataclasses
import math
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

_WORD = 32
_LEVEL = 9


@dataclasses.dataclass(frozen=True)
class PackedArray:
    """An array as a page holds it.

    Attributes:
        shape: its lengths.
        low: least value.
        quantum: step between two values that it can take.
        width: bytes of each number.
        data: see above.
    """

    shape: list[int]
    low: float
    quantum: float
    width: int
    data: str


def pack(values: np.ndarray, quantum: float) -> PackedArray:
    """Round an array to a quantum and pack it.

    Args:
        values: finite numbers; at least one.
        quantum: twice the error that is allowed.

    Raises:
        ValueError: a number is not finite, or the quantum is too small for their range.
    """
    values = np.asarray(values, float)
    low = float(values.min())
    whole = np.rint((values - low) / quantum)
    if not math.isfinite(float(whole.sum())) or whole.max() >= 2 ** (_WORD - 2):
        raise ValueError(
            f"numbers from {low:g} to {values.max():g} cannot be kept in steps of {quantum:g}. Give"
            " finite numbers and a larger step."
        )
    steps = np.diff(whole.astype(np.int64), axis=0, prepend=0).ravel()
    folded = np.where(steps < 0, -2 * steps - 1, 2 * steps)
    width = max(1, -(-int(folded.max()).bit_length() // 8))
    planes = folded.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T
    data = zlib.compress(np.ascontiguousarray(planes).tobytes(), _LEVEL)
    return PackedArray(list(values.shape), low, quantum, width, base64.b64encode(data).decode())


def unpacked(packed: PackedArray | Mapping[str, Any]) -> np.ndarray:
    """The array again, as the page reads it."""
    part = packed if isinstance(packed, PackedArray) else PackedArray(**packed)
    raw = np.frombuffer(zlib.decompress(base64.b64decode(part.data)), np.uint8)
    planes = raw.reshape(part.width, -1).astype(np.int64)
    folded = np.sum(planes << (8 * np.arange(part.width))[:, None], axis=0)
    steps = np.where(folded & 1, -((folded + 1) >> 1), folded >> 1).reshape(part.shape)
    return part.low + part.quantum * np.cumsum(steps, axis=0)
