import importlib.util
import pathlib
import types

import pytest


def _load(name: str) -> types.ModuleType:
    path = pathlib.Path(__file__).parent / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def branched_tube():
    """Builder of the small anatomy of `branched_tube.py`."""
    return _load("branched_tube").branched_tube
