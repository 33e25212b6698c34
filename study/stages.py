"""Stages of a long computation, each kept beside the hash of what it follows from.

A stage is found again only under the same inputs; a changed input computes that stage anew, and
those whose own inputs it changes. Values pass through JSON (arrays through NPZ) also when they are
fresh, so that an interrupted computation ends with the same numbers as one that ran through.
"""

import hashlib
import io
import json
import pathlib
import zipfile
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from jaxfsi.fields.frame import write_whole

FORMAT = 1
"""Part of every hash; grows when a stage changes its meaning."""


def stage_key(*inputs: Any) -> str:
    """Hash of plain values, frozen dataclasses and texts."""
    return hashlib.sha256(repr((FORMAT, inputs)).encode()).hexdigest()[:32]


class Stages:
    """Stages in a folder, one file each."""

    def __init__(self, folder: pathlib.Path):
        """Nothing is made before the first stage is kept."""
        self.folder = folder

    def known(self, name: str, key: str) -> Any | None:
        """The value kept under a name and key; None where there is none."""
        try:
            stored = json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8"))
            return stored["value"] if stored["key"] == key else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def value(self, name: str, key: str, compute: Callable[[], Any]) -> Any:
        """A value that JSON can hold: kept, or computed and kept.

        Args:
            name: of the stage, fit for a file name.
            key: hash of its inputs, see `stage_key`.
            compute: gives it.
        """
        found = self.known(name, key)
        if found is not None:
            return found
        text = json.dumps({"key": key, "value": compute()}, allow_nan=False)
        self._write(f"{name}.json", text.encode())
        return json.loads(text)["value"]

    def arrays(
        self, name: str, key: str, compute: Callable[[], Mapping[str, np.ndarray]]
    ) -> dict[str, np.ndarray]:
        """Arrays by name: kept, or computed and kept."""
        path = self.folder / f"{name}.npz"
        try:
            with np.load(path) as file:
                if str(file["key"]) == key:
                    return {part: file[part] for part in file.files if part != "key"}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            pass
        found = {part: np.asarray(array) for part, array in compute().items()}
        buffer = io.BytesIO()
        np.savez(buffer, key=np.array(key), **found)  # pyright: ignore[reportArgumentType]
        self._write(f"{name}.npz", buffer.getvalue())
        return found

    def _write(self, name: str, content: bytes) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.folder / name, content)
