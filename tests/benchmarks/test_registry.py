"""Every benchmark that the command offers can be imported and called as the command does."""

import importlib
import inspect

import pytest

from benchmarks.__main__ import BENCHMARKS, LONG


@pytest.mark.parametrize("name", [*BENCHMARKS, *LONG])
def test_benchmark_takes_its_rounds(name):
    run = importlib.import_module(f"benchmarks.{name}").run
    inspect.signature(run).bind(rounds=1)
    own = {"meshing": {"preset": "coarse"}, "verification": {"problems": ["x"]}}.get(name, {})
    inspect.signature(run).bind(rounds=1, **own)
