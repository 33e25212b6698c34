"""Public names are imported on first use, and mean what they meant when imported at once."""

import inspect
import pathlib
import subprocess
import sys

import pytest

import calibration
import diagnosis
import jaxfsi
import lumped
import study
from jaxfsi import anatomy, core, fields, mesh_files, meshing, simulation

_PACKAGES = (lumped, jaxfsi, calibration, diagnosis, study)
_ROOMS = (anatomy, core, fields, mesh_files, meshing, simulation)


@pytest.mark.parametrize("package", _PACKAGES, ids=lambda package: package.__name__)
def test_every_public_name_is_there_and_none_is_a_module(package):
    for name in package.public_names:
        assert not inspect.ismodule(getattr(package, name)), name
        assert name in dir(package)
    with pytest.raises(AttributeError, match="has no attribute 'no_such_name'"):
        _ = package.no_such_name


@pytest.mark.parametrize("package", [*_PACKAGES, *_ROOMS], ids=lambda package: package.__name__)
def test_all_lists_the_public_names(package):
    """Type checkers read ``__all__``: what is not there is private to them."""
    assert sorted(package.__all__) == sorted(package.public_names)


@pytest.mark.parametrize("package", _PACKAGES, ids=lambda package: package.__name__)
def test_package_says_that_it_is_typed(package):
    assert (pathlib.Path(package.__file__).parent / "py.typed").is_file()


def _said(program: str) -> str:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_packages_do_without_jax_until_a_name_needs_it():
    names = ", ".join(package.__name__ for package in _PACKAGES)
    seen = "print('jax' in sys.modules, 'numpy' in sys.modules)"
    program = f"import sys, {names}, study.case.read; {seen}"
    assert _said(program) == "False False"


def test_function_wins_over_the_module_of_its_name():
    program = (
        "import lumped.march; from lumped import march; print(march.__module__, callable(march))"
    )
    assert _said(program) == "lumped.march True"


@pytest.mark.parametrize("first", ["import lumped, jax", "import jax, lumped"])
def test_precision_is_double_whoever_imports_jax(first):
    assert _said(f"{first}; print(jax.numpy.ones(1).dtype)") == "float64"
