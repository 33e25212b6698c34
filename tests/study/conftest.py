"""One run of the demo case through the command line, shared by all tests that look at it."""

import contextlib
import importlib.util
import io
import json
import os
import pathlib
import time
import types
from typing import Any, NamedTuple

import pytest

from study.cli.entry import main
from study.store.cache_folder import VARIABLE

_LONGEST = 600.0
"""How long a demo run may take [s]."""


class Outcome(NamedTuple):
    """What a command returned, printed and wrote."""

    status: int
    stdout: str
    stderr: str
    folder: pathlib.Path

    @property
    def json(self) -> dict[str, Any]:
        return json.loads(self.stdout)

    def written(self, name: str = "result.json") -> dict[str, Any]:
        return json.loads((self.folder / name).read_text(encoding="utf-8"))


def run_command(*arguments: object, folder: pathlib.Path | None = None) -> Outcome:
    """Run a command in this process, the compilation cache left off."""
    out = [] if folder is None else ["--out", str(folder)]
    stdout, stderr = io.StringIO(), io.StringIO()
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = "off"
    try:
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            status = main([*map(str, arguments), *out])
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before
    return Outcome(status, stdout.getvalue(), stderr.getvalue(), folder or pathlib.Path())


@pytest.fixture(scope="session")
def command():
    """Runs a command in this process."""
    return run_command


@pytest.fixture(scope="session")
def tube() -> types.ModuleType:
    """The module `tube_case`."""
    path = pathlib.Path(__file__).with_name("tube_case.py")
    spec = importlib.util.spec_from_file_location("tube_case", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """`jaxfsi run --demo --json` without its mesh, once for all processes of a run."""
    own = tmp_path_factory.getbasetemp()
    place = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "demo"
    said, part = place / "said.json", place / "said.part"
    try:
        place.mkdir()
    except FileExistsError:  # another process makes it
        end = time.monotonic() + _LONGEST
        while not said.exists():
            assert time.monotonic() < end, "the process that runs the demo has not ended"
            time.sleep(0.2)
        return Outcome(*json.loads(said.read_text()), place / "results")
    outcome = Outcome(1, "", "it was ended", place)
    try:
        outcome = run_command("run", "--demo", "--no-mesh", "--json", folder=place / "results")
    finally:
        part.write_text(json.dumps(outcome[:3]))
        part.rename(said)
    return outcome
