"""Pictures of results: in memory, as texts that stand inside HTML, and beside a document."""

import base64
import dataclasses
import pathlib
from collections.abc import Iterable, Mapping
from typing import Any

from study.store.result_files import MESH_PICTURES, SIMULATION_PICTURES, STUDY_PICTURES

_FILM = "film.gif"


@dataclasses.dataclass(frozen=True)
class Drawn:
    """Pictures of a run.

    Attributes:
        pictures: PNG files by name.
        times: instants that they show [s].
        note: why there are none, if so.
    """

    pictures: dict[str, bytes]
    times: list[float]
    note: str | None


def embedded_pictures(pictures: Mapping[str, bytes]) -> dict[str, str]:
    """PNG files as texts that stand inside HTML."""
    return {name: picture_text(content) for name, content in pictures.items()}


def picture_text(content: bytes) -> str:
    """A PNG file as the address of a picture."""
    return "data:image/png;base64," + base64.b64encode(content).decode("ascii")


def film_text(content: bytes) -> str:
    """An animation as the address of a picture."""
    return "data:image/gif;base64," + base64.b64encode(content).decode("ascii")


def write_simulation_pictures(folder: pathlib.Path, drawn: Drawn) -> None:
    """Write the pictures of a run into a folder that is being filled."""
    _write(folder / SIMULATION_PICTURES, {f"{n}.png": c for n, c in drawn.pictures.items()})


def write_mesh_pictures(folder: pathlib.Path, state: str, pictures: Mapping[str, bytes]) -> None:
    """Write the pictures of the mesh of a state into a folder that is being filled."""
    _write(folder / MESH_PICTURES, {f"{state}-{n}.png": c for n, c in pictures.items()})


def write_study_pictures(
    folder: pathlib.Path, drawn: Mapping[str, Drawn], films: Mapping[str, bytes]
) -> None:
    """Write the pictures of a study into a folder that is being filled.

    Args:
        folder: the folder.
        drawn: pictures by id of the run.
        films: animations by id of the run.
    """
    (folder / STUDY_PICTURES).mkdir()
    for run, part in drawn.items():
        _write(folder / STUDY_PICTURES, {f"{run}-{n}.png": c for n, c in part.pictures.items()})
    _write(folder / STUDY_PICTURES, {f"{run}-{_FILM}": film for run, film in films.items()})


def stored_mesh_pictures(
    folder: pathlib.Path, document: Mapping[str, Any]
) -> dict[str, dict[str, str]]:
    """Pictures of meshes that lie in an output folder; those that are gone are left out.

    Args:
        folder: the folder.
        document: of the command `mesh`, or the part of a document that describes meshes.
    """
    place = folder / MESH_PICTURES
    states = document["states"].items()
    return {state: _stored(place, entry["pictures"], f"{state}-") for state, entry in states}


def stored_simulation_pictures(folder: pathlib.Path, document: Mapping[str, Any]) -> dict[str, str]:
    """The same of a run."""
    return _stored(folder / SIMULATION_PICTURES, document["pictures"])


def stored_study_pictures(
    folder: pathlib.Path, document: Mapping[str, Any]
) -> dict[str, dict[str, str]]:
    """The same of a study, by id of the run."""
    place = folder / STUDY_PICTURES
    return {run: _stored(place, names, f"{run}-") for run, names in document["pictures"].items()}


def stored_films(folder: pathlib.Path, document: Mapping[str, Any]) -> dict[str, str]:
    """The same of the animations of a study."""
    paths = {run: folder / STUDY_PICTURES / f"{run}-{_FILM}" for run in document["films"]}
    return {run: film_text(path.read_bytes()) for run, path in paths.items() if path.is_file()}


def _write(place: pathlib.Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        place.mkdir(exist_ok=True)
        (place / name).write_bytes(content)


def _stored(place: pathlib.Path, names: Iterable[str], prefix: str = "") -> dict[str, str]:
    paths = {name: place / f"{prefix}{name}.png" for name in names}
    return {name: picture_text(path.read_bytes()) for name, path in paths.items() if path.is_file()}
