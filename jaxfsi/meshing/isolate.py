"""Native meshers in child processes: a crash, a hang or an exception becomes one clear error.

A native mesher may abort the process that calls it, so each call runs in a child of its own.
Arrays go there and come back through an npz file in a temporary folder. The child starts from a
file of `jaxfsi.meshing.native` and imports nothing of this package, which keeps its start short.
"""

import concurrent.futures
import contextlib
import json
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

Arrays = dict[str, np.ndarray]

NATIVE_FOLDER = pathlib.Path(__file__).parent / "native"
DEFAULT_TIMEOUT = 900.0
_INSTALL = {
    "mmgpy": "pip install mmgpy",
    "netgen": "pip install netgen-mesher",
    "gmsh": "pip install gmsh (GPL)",
    "tetgen": "pip install tetgen (AGPL)",
}


class MeshingError(RuntimeError):
    """A mesher failed, or what it made did not pass a gate."""


class NotInstalledError(MeshingError):
    """A mesher is not there; trying again does not help."""


class NativeCall(NamedTuple):
    """One call of a native mesher.

    Attributes:
        module: file of the adapter; it defines ``run(arrays, options) -> arrays``.
        arrays: input arrays.
        options: settings that JSON can hold.
        timeout: wall time after which the child is ended [s].
    """

    module: pathlib.Path
    arrays: Arrays
    options: dict[str, object]
    timeout: float = DEFAULT_TIMEOUT


# NumPy parses the header of each array with `ast`, where threads of Python 3.11 disturb each other:
# "AST constructor recursion depth mismatch" (SystemError).
_READING = threading.Lock()


def native_call(
    name: str,
    arrays: Arrays,
    options: dict[str, object] | None = None,
    *,
    timeout: float = DEFAULT_TIMEOUT,
) -> NativeCall:
    """A call of one of the adapters in `jaxfsi.meshing.native`, by name."""
    return NativeCall(NATIVE_FOLDER / f"{name}.py", arrays, options or {}, timeout)


def run_isolated(call: NativeCall) -> Arrays:
    """Run one native mesher in a child process.

    Returns:
        The arrays that the adapter returned.

    Raises:
        NotInstalledError: the mesher is not installed or cannot be loaded.
        MeshingError: it crashed, ran too long or raised an error.
    """
    name = call.module.stem.removeprefix("fill_")
    with tempfile.TemporaryDirectory(prefix="mesher-") as name_of_folder:
        folder = pathlib.Path(name_of_folder)
        np.savez(folder / "in.npz", **call.arrays)  # pyright: ignore[reportArgumentType]
        (folder / "options.json").write_text(json.dumps(call.options))
        command = [sys.executable, "-P", str(NATIVE_FOLDER / "child.py"), str(call.module)]
        try:
            done = _run([*command, str(folder)], call.timeout)
        except subprocess.TimeoutExpired as error:
            raise MeshingError(
                f"{name} was ended after {call.timeout:g} s. Use a coarser preset, or allow more"
                " time."
            ) from error
        fault = folder / "error.json"
        if fault.exists():
            raise _told(name, json.loads(fault.read_text()))
        if done.returncode != 0:
            raise MeshingError(_ended(name, done))
        with _READING, np.load(folder / "out.npz") as out:
            return {key: out[key] for key in out.files}


def run_all_isolated(calls: Sequence[NativeCall]) -> list[Arrays]:
    """Run several native meshers side by side; the results keep the order of the calls."""
    with threads_of_children(len(calls)) as pool:
        return list(pool.map(run_isolated, calls))


@contextlib.contextmanager
def threads_of_children(n: int) -> Iterator[concurrent.futures.ThreadPoolExecutor]:
    """Threads that call `run_isolated`; where the block is interrupted, their children are ended.

    Args:
        n: children at once.
    """
    with concurrent.futures.ThreadPoolExecutor(max_workers=max(n, 1)) as pool:
        try:
            yield pool
        except KeyboardInterrupt:  # else the threads would wait for the children to end
            pool.shutdown(wait=False, cancel_futures=True)
            for process in list(_RUNNING):
                process.kill()
            raise


_RUNNING: set[subprocess.Popen[str]] = set()
"""Children at work."""


def _run(command: list[str], timeout: float) -> subprocess.CompletedProcess[str]:
    """Run a child to its end; it ends with an error here."""
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, errors="replace"
    ) as process:
        _RUNNING.add(process)
        try:
            out, err = process.communicate(timeout=timeout)
        except BaseException:
            process.kill()
            raise
        finally:
            _RUNNING.discard(process)
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def _told(name: str, fault: dict[str, str]) -> MeshingError:
    if fault["kind"] in ("ImportError", "ModuleNotFoundError"):
        package = fault.get("package") or name
        cure = _INSTALL.get(package, f"pip install {package}")
        return NotInstalledError(
            f"{package} is not installed or cannot be loaded ({fault['message']}). Install it"
            f" ({cure}), or choose another backend."
        )
    return MeshingError(
        f"{name} failed: {fault['kind']}: {fault['message']}. Try a finer preset, another backend,"
        " or a lumen with less acute corners."
    )


def _ended(name: str, done: subprocess.CompletedProcess[str]) -> str:
    tail = " / ".join((done.stderr or done.stdout or "").strip().splitlines()[-3:]) or "no message"
    if done.returncode < 0:
        try:
            how = f"crashed with {signal.Signals(-done.returncode).name}"
        except ValueError:
            how = f"was ended by signal {-done.returncode}"
    else:
        how = f"ended with exit status {done.returncode}"
    return (
        f"{name} {how} ({tail}). Its input surface probably cuts itself or is too coarse for a thin"
        " part: try a finer preset or another backend."
    )
