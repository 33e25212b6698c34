"""Checkpoints: everything that a run needs to go on to the same answer, bit for bit.

One npz file, written under a temporary name, brought to the disk, then renamed: there is always a
whole one. It holds the hash of the model and of the choices of the run, and the caller's name for
the code that computes; a run with other input or other code refuses it, and so does one that finds
an array missing or of another shape.
"""

import hashlib
import io
import json
import pathlib
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxfsi.core.step.state import State
from jaxfsi.fields.npz import load_arrays
from jaxfsi.simulation.observer import ObserverState
from jaxfsi.simulation.record import StepHistory
from jaxfsi.simulation.step_control import Position
from jaxfsi.text_files import why
from lumped.whole_files import write_whole

FORMAT = 3

# What `load_arrays` and `json.loads` raise on other files and on damaged ones.
_DAMAGE = (ValueError, TypeError, KeyError, RuntimeError)


class CheckpointError(ValueError):
    """A checkpoint that cannot be used; says what happened and what to try.

    Attributes:
        problem: what happened, without the file's name.
        n_steps: whole steps that the file holds, where these are more than were asked for.
    """

    def __init__(self, path: pathlib.Path, problem: str, cure: str, n_steps: int | None = None):
        ValueError.__init__(self, f"{path} {problem}. {cure}")
        self.problem = problem
        self.n_steps = n_steps


class Checkpoint(NamedTuple):
    """A run between two steps.

    Attributes:
        state: the state.
        position: where the run is.
        record: of all steps so far.
        events: what went wrong and was mended, see `simulate`.
        observer_states: of the observers, by name.
    """

    state: State
    position: Position
    record: StepHistory
    events: list[dict[str, Any]]
    observer_states: dict[str, ObserverState]


class RunHash(NamedTuple):
    """What tells a run from others.

    Attributes:
        everything: hash of structure and numbers of its model, start and choices.
        structure: of the structure alone, that is fields, laws, names, types and shapes.
    """

    everything: str
    structure: str


def fingerprint(*parts: Any) -> RunHash:
    """Hashes of trees of arrays and plain values."""
    digest, structure_digest = hashlib.sha256(), hashlib.sha256()
    leaves, structure = jax.tree.flatten(parts)
    for of in (digest, structure_digest):
        of.update(str(structure).encode())
    for leaf in leaves:
        if hasattr(leaf, "shape"):
            array = np.asarray(leaf)
            for of in (digest, structure_digest):
                of.update(f"{array.dtype.str}{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        else:
            digest.update(repr(leaf).encode())
            if isinstance(leaf, str):
                structure_digest.update(leaf.encode())
    return RunHash(digest.hexdigest(), structure_digest.hexdigest())


def save_checkpoint(
    path: pathlib.Path, checkpoint: Checkpoint, run_hash: RunHash, numerics: str = ""
) -> None:
    """Write a checkpoint; the one before is replaced when this one is on disk."""
    arrays = _arrays(checkpoint)
    head = {
        "format": FORMAT,
        "run_hash": run_hash.everything,
        "structure": run_hash.structure,
        "numerics": numerics,
        "position": list(checkpoint.position),
        "events": checkpoint.events,
        "observers": sorted(checkpoint.observer_states),
    }
    arrays["head"] = np.frombuffer(json.dumps(head).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # pyright: ignore[reportArgumentType]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, buffer.getvalue(), lasting=True)


def load_checkpoint(
    path: pathlib.Path, like: Checkpoint, run_hash: RunHash, numerics: str = ""
) -> Checkpoint:
    """Read a checkpoint and check that it holds all that the run needs.

    Args:
        path: the file.
        like: the start of the run, for the names, types and shapes of what must be there.
        run_hash: hashes of the run that is to go on.
        numerics: the caller's name for the code that computes, see `simulate`.

    Raises:
        CheckpointError: the file is damaged, or belongs to another run.
    """
    try:
        arrays = load_arrays(path)
        head = dict(json.loads(arrays.pop("head").tobytes()))
    except (OSError, *_DAMAGE) as error:
        raise CheckpointError(
            path, f"cannot be read as a checkpoint: {why(error)}", "Remove it to start again."
        ) from None
    if head.get("format") != FORMAT:
        raise CheckpointError(
            path,
            f"has format {head.get('format')!r}, that of another version; this one reads {FORMAT}",
            "Continue it with the version that wrote it, or start again in another folder.",
        )
    if head.get("run_hash") != run_hash.everything:
        raise _other_run(path, head.get("structure"), run_hash)
    if head.get("numerics", "") != numerics:
        raise CheckpointError(
            path,
            "was begun with another version of the code or of its libraries, whose numbers differ",
            "Restore that version, or start again in another folder.",
        )
    problems = [*_head_problems(head), *_array_problems(arrays, like)]
    if problems:
        more = f" and {len(problems) - 3} more" if len(problems) > 3 else ""
        raise CheckpointError(
            path,
            f"is damaged: {', '.join(problems[:3])}{more}",
            "Put back a copy, or remove it to start again.",
        )
    leaves, structure = jax.tree.flatten(like.state)
    stored = [jnp.asarray(arrays[f"state.{k}"]) for k in range(len(leaves))]
    return Checkpoint(
        jax.tree.unflatten(structure, stored),
        Position(*head["position"]),
        StepHistory(**{name: arrays[f"record.{name}"] for name in StepHistory._fields}),
        head["events"],
        {
            owner: {name: arrays[f"observer.{owner}.{name}"] for name in saved_state}
            for owner, saved_state in like.observer_states.items()
        },
    )


def _other_run(path: pathlib.Path, structure: Any, run_hash: RunHash) -> CheckpointError:
    """The refusal of a checkpoint of another run, as exact as what the file tells."""
    numbers = "belongs to a run with another model, step or choice of outputs"
    if structure == run_hash.structure:
        cure = "Restore the input, or start again in another folder."
        return CheckpointError(
            path, f"{numbers}: the same parts and sizes with other numbers", cure
        )
    parts = (
        f"{numbers} (other openings, laws, options or mesh), or was begun by a version of the code"
        " whose model has other fields"
    )
    cure = "Restore the input or that version, or start again in another folder."
    return CheckpointError(path, parts, cure)


def _arrays(checkpoint: Checkpoint) -> dict[str, np.ndarray]:
    """The arrays of a checkpoint under the names that they have in its file."""
    arrays: dict[str, np.ndarray] = {}
    for k, leaf in enumerate(jax.tree.leaves(checkpoint.state)):
        arrays[f"state.{k}"] = np.asarray(leaf)
    for name, column in checkpoint.record._asdict().items():
        arrays[f"record.{name}"] = column
    for owner, saved_state in checkpoint.observer_states.items():
        for name, value in saved_state.items():
            arrays[f"observer.{owner}.{name}"] = np.asarray(value)
    return arrays


def _head_problems(head: dict[str, Any]) -> list[str]:
    """What is wrong with the part that is no array."""
    problems = []
    position, events = head.get("position"), head.get("events")
    fields = len(Position._fields)
    if not (
        isinstance(position, list)
        and len(position) == fields
        and all(type(number) is int and number >= 0 for number in position)
    ):
        problems.append(f"its position is not {fields} whole numbers")
    if not (isinstance(events, list) and all(isinstance(event, dict) for event in events)):
        problems.append("its events are no list of tables")
    return problems


def _array_problems(arrays: dict[str, np.ndarray], like: Checkpoint) -> list[str]:
    """Arrays that are missing, or not of the type and shape that the run needs."""
    problems = []
    times = arrays.get("record.t")
    rows = len(times) if times is not None and times.ndim else 0
    for name, wanted in _arrays(like).items():
        found = arrays.get(name)
        shape = (rows, *wanted.shape[1:]) if name.startswith("record.") else wanted.shape
        if found is None:
            problems.append(f"{name} is missing")
        elif found.shape != shape or found.dtype != wanted.dtype:
            problems.append(
                f"{name} is {_described(found.dtype, found.shape)},"
                f" not {_described(wanted.dtype, shape)}"
            )
    return problems


def _described(dtype: np.dtype, shape: tuple[int, ...]) -> str:
    return f"{dtype} of shape {shape}"
