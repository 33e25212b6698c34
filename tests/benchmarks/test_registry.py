"""Every benchmark that the command offers can be imported and called as the command does."""

import importlib
import inspect
import subprocess
import sys

import pytest

from benchmarks.__main__ import BENCHMARKS, LONG, main


@pytest.mark.parametrize("name", [*BENCHMARKS, *LONG])
def test_benchmark_takes_its_rounds(name):
    run = importlib.import_module(f"benchmarks.{name}").run
    own = {"meshing": {"preset"}, "verification": {"problems"}}.get(name, set())
    assert {"rounds", *own} <= inspect.signature(run).parameters.keys()


def test_benchmarks_can_be_imported_without_extras():
    program = f"""
import importlib, sys
sys.modules.update(dict.fromkeys(["blackjax", "sklearn", "skfem", "pysvzerod"]))
for name in {[*BENCHMARKS, *LONG]}:
    importlib.import_module(f"benchmarks.{{name}}")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_unknown_problems_are_refused_with_those_there_are(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["benchmarks", "--only", "verification", "--problems", "waves"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "'waves' is none of wave, pulse" in capsys.readouterr().err
