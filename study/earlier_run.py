"""What an earlier run of `simulate` left in a folder: moved aside, or removed.

Files of two runs never lie side by side: a new run that fails in its first step writes neither
history nor shear, and those of the run before would pass for its own.
"""

import os
import pathlib

from study.results import SIMULATION_FILE, SIMULATION_PAGE
from study.simulation_results import PICTURE_FOLDER
from study.simulation_run import CHECKPOINT_FILE, FIELD_FOLDER, HISTORY_FILE, SHEAR_FILE

EARLIER = "earlier-"
"""How the names of the folders of earlier runs begin."""

_COMPUTED = (CHECKPOINT_FILE, HISTORY_FILE, SHEAR_FILE)
_SHOWN = (SIMULATION_FILE, SIMULATION_PAGE, PICTURE_FOLDER)


def clear_run(folder: pathlib.Path) -> None:
    """Remove what a run computed in a folder."""
    for name in _COMPUTED:
        (folder / name).unlink(missing_ok=True)
    for path in (folder / FIELD_FOLDER).glob("fields*"):
        path.unlink()


def set_aside(folder: pathlib.Path) -> pathlib.Path | None:
    """Move all files of a run into a sub-folder of its own, numbered by age.

    Returns:
        The sub-folder; None where there was no run.
    """
    names = [*_COMPUTED, FIELD_FOLDER, *_SHOWN]
    paths = [folder / name for name in names if (folder / name).exists()]
    if not paths:
        return None
    numbers = [path.name.removeprefix(EARLIER) for path in folder.glob(f"{EARLIER}*")]
    latest = max((int(number) for number in numbers if number.isdecimal()), default=0)
    place = folder / f"{EARLIER}{latest + 1}"
    place.mkdir()
    for path in paths:
        os.replace(path, place / path.name)
    return place


def can_go_on(folder: pathlib.Path) -> bool:
    """Whether a run lies in a folder that the same command can go on with."""
    return (folder / CHECKPOINT_FILE).exists()
