"""Native calls side by side."""

import ast
import os
import subprocess
import sys

import numpy as np
import pytest

from jaxfsi.meshing import isolate
from jaxfsi.meshing.isolate import NativeCall, run_all_isolated

ECHO = """\
def run(arrays, options):
    return {f"a{i}": arrays["x"] + i for i in range(4)}
"""


def test_results_come_back_in_order_and_are_read_one_at_a_time(tmp_path, monkeypatch):
    module = tmp_path / "echo.py"
    module.write_text(ECHO)
    parse, guarded = ast.literal_eval, []

    def watched(text):
        guarded.append(isolate._READING.locked())
        return parse(text)

    monkeypatch.setattr(ast, "literal_eval", watched)
    calls = [NativeCall(module, {"x": np.full(3, float(k))}, {}, 60.0) for k in range(3)]
    for k, out in enumerate(run_all_isolated(calls)):
        for i in range(4):
            np.testing.assert_array_equal(out[f"a{i}"], np.full(3, float(k + i)))
    # NumPy parses one header for each array read back.
    assert guarded == [True] * 12


_INTERRUPTED = """
import os, pathlib, signal, sys, threading
from jaxfsi.meshing.isolate import NativeCall, run_all_isolated
folder = pathlib.Path(sys.argv[1])
adapter = folder / "sleeper.py"
adapter.write_text(
    "import pathlib, time\\n"
    "def run(arrays, options):\\n"
    "    pathlib.Path(options['begun']).touch()\\n"
    "    time.sleep(100.0)\\n"
)
calls = [NativeCall(adapter, {}, {"begun": str(folder / name)}) for name in "ab"]
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it

def interrupt():
    while not all((folder / name).exists() for name in "ab"):
        threading.Event().wait(0.05)
    os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=interrupt, daemon=True).start()
try:
    run_all_isolated(calls)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_interrupt_ends_the_children(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", _INTERRUPTED, tmp_path], capture_output=True, text=True, timeout=60
    )
    assert (done.stdout, done.stderr) == ("interrupted\n", "")
