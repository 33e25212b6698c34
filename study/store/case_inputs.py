"""The files that a case names, and where a result of a case comes from."""

import pathlib
from collections.abc import Sequence

from study.case.anatomy import IvusAnatomy, MeshAnatomy, SurfaceAnatomy
from study.case.model import Case
from study.store.options import Options
from study.store.provenance import InputFile, Provenance, input_file, origin


def provenance(case: Case, command: Sequence[str], options: Options) -> Provenance:
    """What must be known to compute a result again.

    Args:
        case: the case; its file and all files that it names are hashed.
        command: the command as it was given.
        options: of the command.
    """
    return origin(input_files(case), case.path.parent, command, options)


def inputs_of(case: Case) -> list[InputFile]:
    """Name, hash and size of the case file and of every file that it names."""
    return [input_file(path, case.path.parent) for path in input_files(case)]


def input_files(case: Case) -> list[pathlib.Path]:
    """The case file and every file that it names, each once."""
    files = [case.path]
    match case.anatomy:
        case IvusAnatomy(states=states, lines=lines):
            files += [file for state in states.values() for file in state.files]
            files += lines
        case SurfaceAnatomy(files=named):
            files += named
        case MeshAnatomy(places=places):
            files += [file for place in places for file in files_of(place)]
        case _:
            pass
    files += [c.waveform.path for c in case.conditions.values() if c.waveform is not None]
    return list(dict.fromkeys(files))


def files_of(place: pathlib.Path) -> list[pathlib.Path]:
    """Files of a mesh: those below its folder, or the file and the JSON beside it."""
    if not place.is_dir():
        beside = place.with_suffix(".json")
        return [place, *([beside] if beside.is_file() else [])]
    return sorted(path for path in place.rglob("*") if path.is_file())
