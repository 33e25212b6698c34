"""Checkpoints: everything that a run needs to go on to the same answer, bit for bit.

One npz file, written under a temporary name, brought to the disk, then renamed: there is always a
whole one. It holds the hash of the model and of the choices of the run; a run with other input
refuses it.
"""

import hashlib
import io
import json
import pathlib
import zipfile
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxfsi.core.state import State
from jaxfsi.fields.frame import write_whole
from jaxfsi.simulation.observer import Memory
from jaxfsi.simulation.record import Record
from jaxfsi.simulation.step_control import Position

FORMAT = 1


class CheckpointError(ValueError):
    """A checkpoint that cannot be used; says what happened and what to try."""


class Checkpoint(NamedTuple):
    """A run between two steps.

    Attributes:
        state: the state.
        position: where the run is.
        record: of all steps so far.
        events: what went wrong and was mended, see `simulate`.
        memories: of the observers, by name.
    """

    state: State
    position: Position
    record: Record
    events: list[dict[str, Any]]
    memories: dict[str, Memory]


def fingerprint(*parts: Any) -> str:
    """Hash of trees of arrays and plain values: their structure, types, shapes and bits."""
    digest = hashlib.sha256()
    leaves, structure = jax.tree.flatten(parts)
    digest.update(str(structure).encode())
    for leaf in leaves:
        if hasattr(leaf, "shape"):
            array = np.asarray(leaf)
            digest.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        else:
            digest.update(repr(leaf).encode())
    return digest.hexdigest()


def save_checkpoint(path: pathlib.Path, checkpoint: Checkpoint, run_hash: str) -> None:
    """Write a checkpoint; the one before is replaced when this one is on disk."""
    arrays: dict[str, np.ndarray] = {}
    for k, leaf in enumerate(jax.tree.leaves(checkpoint.state)):
        arrays[f"state.{k}"] = np.asarray(leaf)
    for name, column in checkpoint.record._asdict().items():
        arrays[f"record.{name}"] = column
    for owner, memory in checkpoint.memories.items():
        for name, value in memory.items():
            arrays[f"memory.{owner}.{name}"] = np.asarray(value)
    head = {
        "format": FORMAT,
        "run_hash": run_hash,
        "position": list(checkpoint.position),
        "events": checkpoint.events,
        "observers": sorted(checkpoint.memories),
    }
    arrays["head"] = np.frombuffer(json.dumps(head).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # pyright: ignore[reportArgumentType]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, buffer.getvalue(), lasting=True)


def load_checkpoint(path: pathlib.Path, like: State, run_hash: str) -> Checkpoint:
    """Read a checkpoint.

    Args:
        path: the file.
        like: a state of the same model, for the structure.
        run_hash: hash of the run that wants to go on.

    Raises:
        CheckpointError: the file is damaged, or belongs to another run.
    """
    try:
        with np.load(io.BytesIO(path.read_bytes())) as file:
            arrays = {name: file[name] for name in file.files}
        head = json.loads(arrays.pop("head").tobytes())
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise CheckpointError(
            f"{path} cannot be read as a checkpoint: {error}. Remove it to start again."
        ) from None
    if head.get("format") != FORMAT or head.get("run_hash") != run_hash:
        raise CheckpointError(
            f"{path} belongs to a run with another model, step or choice of outputs. Restore the"
            " input, or start again in another folder."
        )
    leaves, structure = jax.tree.flatten(like)
    stored = [jnp.asarray(arrays[f"state.{k}"]) for k in range(len(leaves))]
    record = Record(**{name: arrays[f"record.{name}"] for name in Record._fields})
    memories: dict[str, Memory] = {name: {} for name in head["observers"]}
    for key, value in arrays.items():
        if key.startswith("memory."):
            _, owner, name = key.split(".", 2)
            memories[owner][name] = value
    return Checkpoint(
        jax.tree.unflatten(structure, stored),
        Position(*head["position"]),
        record,
        head["events"],
        memories,
    )
