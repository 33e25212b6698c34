"""A time series of files for ParaView: the PVD file that names each with its time.

The PVD is replaced as a whole after each frame, so that it can be opened while a run goes on; the
frame that it names last is complete.
"""

import math
import pathlib
import re
import xml.etree.ElementTree as ET
from typing import NamedTuple

from jaxfsi.fields.frame import read_time
from lumped.whole_files import write_whole

_STEP = re.compile(r"_(\d+)\.[a-z]+$")


class Entry(NamedTuple):
    """One frame of a series.

    Attributes:
        t: its time [s].
        file: its file, relative to the PVD.
    """

    t: float
    file: str

    @property
    def step(self) -> int:
        """Number of the step that the file's name ends in."""
        found = _STEP.search(self.file)
        return int(found[1]) if found else 0


def frame_name(stem: str, step: int, suffix: str = "vtu") -> str:
    """Name of the file of a step."""
    return f"{stem}_{step:07d}.{suffix}"


def find_frames(folder: pathlib.Path, stem: str, suffix: str = "vtu") -> list[Entry]:
    """The frames that lie in a folder, by step, with the time that each holds.

    A file that is no frame of ours is left out.
    """
    found = []
    for path in folder.glob(f"{stem}_*.{suffix}"):
        entry = Entry(0.0, path.name)
        if path.name == frame_name(stem, entry.step, suffix):
            try:
                found.append(Entry(read_time(path), path.name))
            except ValueError:
                continue
    return sorted(found, key=lambda entry: entry.step)


def write_series(path: pathlib.Path, entries: list[Entry]) -> None:
    """Write a PVD file."""
    rows = [f'<DataSet timestep="{e.t!r}" part="0" file="{e.file}"/>' for e in entries]
    text = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        "<Collection>",
        *rows,
        "</Collection>",
        "</VTKFile>",
    ]
    write_whole(path, "\n".join(text) + "\n")


def read_series(path: pathlib.Path) -> list[Entry]:
    """Entries of a PVD file; none where there is no file.

    A PVD is an index. One that is damaged, or names files that are not there, gives way to the
    frames beside it, each of which holds its own time.
    """
    if not path.is_file():
        return []
    try:
        root = ET.parse(path).getroot()
        found = [Entry(float(e.attrib["timestep"]), e.attrib["file"]) for e in root.iter("DataSet")]
    except (ET.ParseError, ValueError, LookupError):
        return find_frames(path.parent, path.stem)
    if all(_lies_in(path.parent, entry) for entry in found):
        return found
    return find_frames(path.parent, path.stem)


def _lies_in(folder: pathlib.Path, entry: Entry) -> bool:
    is_plain = pathlib.PurePath(entry.file).name == entry.file
    return is_plain and math.isfinite(entry.t) and (folder / entry.file).is_file()
