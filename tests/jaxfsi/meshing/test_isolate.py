"""Native calls side by side."""

import ast

import numpy as np

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
