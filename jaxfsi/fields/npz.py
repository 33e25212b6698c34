"""Arrays of an npz file, none larger than what the file itself holds of it."""

import io
import math
import pathlib
import zipfile

import numpy as np

from jaxfsi.text_files import Malformed, regular_bytes, why

_GROWTH = 4
"""Factor over the size of the file beyond which its content was packed to grow."""

_SLACK = 2**20
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def load_arrays(path: pathlib.Path) -> dict[str, np.ndarray]:
    """All arrays of a file that `numpy.savez` wrote, by name.

    Raises:
        OSError: the file cannot be opened.
        Malformed: it is damaged, or announces more than it holds; nothing of that size was made.
    """
    data = regular_bytes(path)
    try:
        _check(data)
        with np.load(io.BytesIO(data)) as file:
            return {name: file[name] for name in file.files}
    except Malformed:
        raise
    except Exception as error:  # readers of zip and npy raise what they like on damaged bytes
        raise Malformed(why(error)) from error


def _check(data: bytes) -> None:
    with zipfile.ZipFile(io.BytesIO(data)) as store:
        parts = store.infolist()
        total = sum(part.file_size for part in parts)
        if total > _GROWTH * len(data) + _SLACK:
            raise Malformed(f"it announces {total} bytes and has {len(data)}")
        for part in parts:
            with store.open(part) as stream:
                shape, _, kind = _HEADERS[np.lib.format.read_magic(stream)](stream)
            if math.prod(shape) * kind.itemsize > part.file_size:
                raise Malformed(f"{part.filename} announces {shape} numbers and does not hold them")
