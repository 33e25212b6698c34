"""Functions of one record and one hypothesis, compiled for blocks of them.

JAX traces a function in every process before it looks for compiled code: half a minute for these.
Where JAX keeps compiled code on disk, the traced program is kept beside it, under the SHA-256 of
the source, the versions and all shapes, so that a process traces nothing that another one has.
Of an effect outside the catalogue only a function is known, and nothing is kept.
"""

import contextlib
import functools
import hashlib
import importlib.util
import os
import pathlib
import tempfile
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import Any, Generic, TypeVar

import jax
import jax.export
import numpy as np
from jaxtyping import PyTree

from diagnosis.catalogue import CATALOGUE
from diagnosis.effects import Effect, all_forms
from diagnosis.hypothesis import Catalogue
from lumped.device import QUICK_TO_COMPILE

SUFFIX = "-program"
"""End of the name of a traced program on disk."""

KEPT_SHAPES = 8
"""Shapes of records whose compiled code a process keeps, of each program."""

_PACKAGES = ("calibration", "diagnosis", "lumped")
_CHANGES = {id(effect.change): k for k, effect in enumerate(all_forms(CATALOGUE))}

T = TypeVar("T")


class Program(Generic[T]):
    """A function of one record and one hypothesis, for a block of them.

    Args:
        job: called with a record, the effects, the numbers of the catalogue, the positions of two
            effects and further arrays; `nonlinear` and the effects are static, and of these
            nothing but their changes may be used.
        of: makes the result from its arrays.
    """

    def __init__(self, job: Callable[..., Any], of: Callable[..., T]) -> None:
        self._job, self._of = job, of
        self._made: OrderedDict[Any, Future[jax.stages.Compiled]] = OrderedDict()

    def __call__(
        self,
        *arrays: PyTree[Any],
        numbers: Catalogue,
        effects: tuple[Effect, ...],
        nonlinear: bool,
    ) -> T:
        """The job's results: `arrays` are records, pairs and further ones, by a leading axis.

        What failed, or was not begun, ahead is compiled here.
        """
        leaves, tree = jax.tree.flatten((numbers, *arrays))
        leaves = [np.asarray(leaf) for leaf in leaves]
        key = _key(leaves, tree, effects, nonlinear)
        begun = self._made.get(key)
        if begun is None or begun.cancel() or (begun.done() and begun.exception() is not None):
            begun = Future()
            begun.set_running_or_notify_cancel()
            self._keep(key, begun)
            try:
                begun.set_result(self._compiled(leaves, tree, effects, nonlinear))
            except BaseException as error:
                begun.set_exception(error)
        return self._of(*begun.result()(*leaves))

    def ahead(
        self,
        pool: Executor,
        *arrays: PyTree[Any],
        numbers: Catalogue,
        effects: tuple[Effect, ...],
        nonlinear: bool,
    ) -> None:
        """Compile elsewhere what a call with such arrays, of which only shapes are read, needs."""
        leaves, tree = jax.tree.flatten((numbers, *arrays))
        key = _key(leaves, tree, effects, nonlinear)
        if key not in self._made:
            self._keep(key, pool.submit(self._compiled, leaves, tree, effects, nonlinear))

    def traced(
        self,
        *arrays: PyTree[Any],
        numbers: Catalogue,
        effects: tuple[Effect, ...],
        nonlinear: bool,
    ) -> jax.export.Exported:
        """The program for such arrays, before it is compiled."""
        leaves, tree = jax.tree.flatten((numbers, *arrays))
        return self._traced(leaves, tree, effects, nonlinear)

    def _keep(self, key: Any, begun: "Future[jax.stages.Compiled]") -> None:
        self._made[key] = begun
        while len(self._made) > KEPT_SHAPES:
            self._made.popitem(last=False)

    def _compiled(
        self, leaves: Sequence[Any], tree: Any, effects: tuple[Effect, ...], nonlinear: bool
    ) -> jax.stages.Compiled:
        path = self._path(leaves, tree, effects, nonlinear)
        program = _read(path)
        if program is None:
            program = self._traced(leaves, tree, effects, nonlinear)
            _write(path, program)
        call = jax.jit(program.call, compiler_options=QUICK_TO_COMPILE)
        return call.lower(*_shapes(leaves)).compile()

    def _traced(
        self, leaves: Sequence[Any], tree: Any, effects: tuple[Effect, ...], nonlinear: bool
    ) -> jax.export.Exported:
        def block(*leaves: Any) -> list[Any]:
            numbers, *arrays = jax.tree.unflatten(tree, leaves)

            def one(measured: Any, pair: Any, *given: Any) -> Any:
                return self._job(measured, effects, numbers, pair, *given, nonlinear=nonlinear)

            return jax.tree.leaves(jax.vmap(one)(*arrays))

        return jax.export.export(jax.jit(block))(*_shapes(leaves))

    def _path(
        self, leaves: Sequence[Any], tree: Any, effects: tuple[Effect, ...], nonlinear: bool
    ) -> pathlib.Path | None:
        """File of a traced program; None where it cannot be kept."""
        folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
        changes = [_CHANGES.get(id(effect.change)) for effect in effects]
        if folder is None or "://" in folder or None in changes:
            return None
        name = self._job.__name__
        shapes = [(leaf.shape, str(leaf.dtype)) for leaf in leaves]
        versions = _source(), jax.__version__, jax.default_backend()
        told = repr((name, versions, str(tree), shapes, changes, nonlinear))
        digest = hashlib.sha256(told.encode()).hexdigest()
        return pathlib.Path(folder) / f"{name}-{digest}{SUFFIX}"


def _key(leaves: Sequence[Any], tree: Any, effects: tuple[Effect, ...], nonlinear: bool) -> Any:
    changes = tuple(effect.change for effect in effects)
    return tree, tuple((leaf.shape, str(leaf.dtype)) for leaf in leaves), changes, nonlinear


def _shapes(leaves: Sequence[Any]) -> list[jax.ShapeDtypeStruct]:
    return [jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves]


@functools.cache
def _source() -> str:
    """Digest of all source that the programs are traced from."""
    found = hashlib.sha256()
    for package in _PACKAGES:
        spec = importlib.util.find_spec(package)
        for folder in (spec and spec.submodule_search_locations) or ():
            for path in sorted(pathlib.Path(folder).rglob("*.py")):
                found.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def _read(path: pathlib.Path | None) -> jax.export.Exported | None:
    """A kept program; None where there is none, or none that can be read."""
    if path is None:
        return None
    with contextlib.suppress(Exception):  # whatever is wrong with the file, it is traced again
        return jax.export.deserialize(bytearray(path.read_bytes()))
    return None


def _write(path: pathlib.Path | None, program: jax.export.Exported) -> None:
    """Keep a program; one that cannot be written costs time, no result."""
    if path is None:
        return
    with contextlib.suppress(Exception):  # of the file, or of what JAX cannot serialise
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(dir=path.parent)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(program.serialize())
            os.replace(name, path)
        except BaseException:
            pathlib.Path(name).unlink(missing_ok=True)
            raise
