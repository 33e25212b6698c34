"""Stages of a long computation, each kept beside the hash of what it follows from.

A stage is found again only under the same inputs and the same numerics (`study.store.numerics`); a
changed input computes that stage anew, and those whose own inputs it changes. Values pass through
JSON (arrays through NPZ) also when they are fresh, so that an interrupted computation ends with the
same numbers as one that ran through. Beside each stands when it was made, and by which code.
"""

import contextlib
import dataclasses
import hashlib
import io
import json
import os
import pathlib
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from jaxfsi.fields.npz import load_arrays
from jaxfsi.text_files import regular_text
from lumped.whole_files import write_whole
from study.store.numerics import decided_by
from study.store.provenance import made_now

FORMAT = 2
"""Part of every hash; grows when a stage changes its meaning."""

Read = TypeVar("Read")

_MADE, _KEY = "made", "key"
_DAMAGE = (OSError, ValueError, KeyError, TypeError, RecursionError)


class Kept(NamedTuple):
    """What was kept of a stage.

    Attributes:
        value: as it was computed.
        made: when and by which code, see `study.store.provenance.made_now`.
    """

    value: Any
    made: dict[str, Any]


def stage_key(kind: str, *inputs: Any) -> str:
    """Hash of inputs and of what decides the numbers of a kind of stage.

    Args:
        kind: one of `study.store.numerics.USES`.
        inputs: plain values, arrays, paths (their names alone) and dataclasses, in any nesting.
            Neither the order of a mapping counts, nor a field that is None: one that is added
            later, and left out, leaves the hash as it is.

    Raises:
        TypeError: an input is of another type.
    """
    text = json.dumps([FORMAT, kind, plain(inputs), decided_by(kind)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def plain(value: Any) -> Any:
    """A value as JSON holds it, so that equal values give equal texts.

    Raises:
        TypeError: it is of a type whose numbers are not known.
    """
    match value:
        case None | bool() | int() | float() | str():
            return value
        case np.ndarray():
            digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
            return ["array", value.dtype.str, list(value.shape), digest]
        case np.generic():
            return value.item()
        case os.PathLike():
            return pathlib.Path(value).name
        case Mapping():
            entries = [[plain(key), plain(entry)] for key, entry in value.items()]
            return ["mapping", *sorted(entries, key=lambda entry: json.dumps(entry[0]))]
        case tuple() | list():
            if hasattr(value, "_asdict"):
                return [type(value).__name__, plain(value._asdict())]  # pyright: ignore
            return [plain(entry) for entry in value]
        case _ if hasattr(value, "__array__"):
            return plain(np.asarray(value))
        case _ if dataclasses.is_dataclass(value) and not isinstance(value, type):
            later = getattr(value, "added_later", ())
            known = {
                f.name: entry
                for f in dataclasses.fields(value)
                if (entry := getattr(value, f.name)) is not None
                and not (f.name in later and entry == f.default)
            }
            return [type(value).__name__, plain(known)]
        case _:
            raise TypeError(f"no key can be made of {type(value).__name__}. Give plain values.")


class Stages:
    """Stages in a folder, one file each."""

    def __init__(self, folder: pathlib.Path):
        """Nothing is made before the first stage is kept."""
        self.folder = folder

    def known(self, name: str, key: str) -> Kept | None:
        """What was kept of a value under a name and key; None where there is nothing."""
        try:
            stored = json.loads(regular_text(self.folder / f"{name}.json"))
            return Kept(stored["value"], dict(stored[_MADE])) if stored[_KEY] == key else None
        except _DAMAGE:
            return None

    def value(
        self,
        name: str,
        key: str,
        compute: Callable[[], Any],
        read: Callable[[Any], Read] = lambda value: value,
    ) -> Read:
        """A value that JSON can hold, None and false among them: kept, or computed and kept.

        Args:
            name: of the stage, fit for a file name.
            key: hash of its inputs, see `stage_key`.
            compute: gives it.
            read: makes what is returned of what JSON holds; a kept value that it refuses is
                damaged and computed again.
        """
        found = self.known(name, key)
        if found is not None:
            with contextlib.suppress(*_DAMAGE):
                return read(found.value)
        return read(self.keep(name, key, compute()))

    def keep(self, name: str, key: str, value: Any, made: Mapping[str, Any] | None = None) -> Any:
        """Keep a value; gives it as it comes back from JSON.

        Args:
            name: of the stage, fit for a file name.
            key: hash of its inputs.
            value: what JSON can hold.
            made: when and by which code; None: now, by this.
        """
        stored = {_KEY: key, _MADE: made or made_now(), "value": value}
        text = json.dumps(stored, allow_nan=False)
        self._write(f"{name}.json", text.encode())
        return json.loads(text)["value"]

    def known_arrays(self, name: str, key: str) -> Kept | None:
        """What was kept of arrays under a name and key; None where there is nothing."""
        try:
            file = load_arrays(self.folder / f"{name}.npz")
            if str(file.pop(_KEY)) != key:
                return None
            made = dict(json.loads(str(file.pop(_MADE))))
            return Kept(file, made)
        except _DAMAGE:
            return None

    def arrays(
        self, name: str, key: str, compute: Callable[[], Mapping[str, np.ndarray]]
    ) -> dict[str, np.ndarray]:
        """Arrays by name: kept, or computed and kept."""
        kept = self.known_arrays(name, key)
        if kept is not None:
            return kept.value
        found = {part: np.asarray(array) for part, array in compute().items()}
        self.keep_arrays(name, key, found)
        return found

    def keep_arrays(
        self,
        name: str,
        key: str,
        arrays: Mapping[str, np.ndarray],
        made: Mapping[str, Any] | None = None,
    ) -> None:
        """Keep arrays by name, in place of those before; the arguments are those of `keep`."""
        said = np.array(json.dumps(made or made_now()))
        buffer = io.BytesIO()
        np.savez(buffer, key=np.array(key), made=said, **arrays)  # pyright: ignore
        self._write(f"{name}.npz", buffer.getvalue())

    def made(self, name: str) -> dict[str, Any] | None:
        """When and by which code the stage of a name was made; None where there is none."""
        try:
            if (self.folder / f"{name}.npz").exists():
                return dict(json.loads(str(load_arrays(self.folder / f"{name}.npz")[_MADE])))
            stored = json.loads(regular_text(self.folder / f"{name}.json"))
            return dict(stored[_MADE])
        except _DAMAGE:
            return None

    def _write(self, name: str, content: bytes) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.folder / name, content)


class PartOfStage:
    """Arrays of a stage at work, kept as they grow."""

    def __init__(self, stages: Stages, name: str, key: str):
        """They are found again only under the same key."""
        self._stages, self._name, self._key = stages, name, key

    def load(self) -> dict[str, np.ndarray] | None:
        """What was kept under the key."""
        kept = self._stages.known_arrays(self._name, self._key)
        return None if kept is None else kept.value

    def save(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep arrays in place of those before."""
        self._stages.keep_arrays(self._name, self._key, arrays)

    def drop(self) -> None:
        """Keep nothing: the stage is finished."""
        (self._stages.folder / f"{self._name}.npz").unlink(missing_ok=True)
