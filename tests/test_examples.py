"""Every example and tutorial runs and prints what its title promises."""

import pathlib
import runpy

import jax
import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

ROOT = pathlib.Path(__file__).parents[1]
EXAMPLES, TUTORIALS = ROOT / "examples", ROOT / "docs" / "tutorials"
PROMISES = {
    "outlet": ["implicit step", "impedance", "mean flow", "Floquet"],
    "calibrate_patient": ["alpha", "closed form", "printed", "all"],
    "sweep_cohort": ["cases: 2000", "rest", "d alpha/d ratio"],
}
PROMISES_LONG = {
    "elastic_tube": ["mean pressure", "Ohm"],
    "wall_and_blood": ["Newtonian", "Carreau-Yasuda", "viscoelastic", "supported"],
    "wall_alone": ["Newton steps", "by Lamé"],
    "fsi_gradient": ["dP / d log E", "wider by 0.1 mm"],
    "alpha_in_loop": ["Pd/Pa in 3D", "reached 0.91 within 0.002: True"],
    "ffr_interval": ["FFR 0.8", "chance of 0.80", "dilation", "of the variance"],
    "ffr_gradient": ["FFR under stress", "resting ratio", "with K"],
    "mesh_from_contours": ["tetrahedra", "anomalous_outlet", "patient.vtu"],
}
"""Examples that only the slow tests and the build of the site run."""
LEARNT = {
    "ten_thousand_patients": ["10000 patients with derivatives", "relative error"],
}
LEARNT_LONG = {
    "first_report": ["anomalous-rca-ivus", "dobutamine", "resting ratio 0.9100"],
    "tube_with_windkessel": ["iterations of GMRES", "by Ohm's law"],
    "from_surface": ["lumen.stl", "tetrahedra", "interface, outer_wall"],
    "from_ultrasound": ["anomalous_outlet", "tetrahedra", "interface"],
    "own_loss": ["E x 0.6", "R_distal x 1."],
    "diagnose_record": ["verdict: named, quadratic_loss"],
    "cohort_on_cluster": ["--array", "virtual-l-01 dobutamine", "calibrated"],
}
"""Tutorials that only the slow tests and the build of the site run."""


def test_every_example_is_tested():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {*PROMISES, *PROMISES_LONG}
    assert {path.stem for path in TUTORIALS.glob("*.py")} == {*LEARNT, *LEARNT_LONG}


def _check(path, promises, capsys):
    mpl.use("Agg")
    try:
        with jax.numpy_rank_promotion("allow"):  # the core multiplies fields by numbers of elements
            runpy.run_path(str(path))
    finally:
        plt.close("all")
    printed = capsys.readouterr().out
    for words in promises:
        assert words in printed
    assert "nan" not in printed


@pytest.mark.parametrize("name", sorted(PROMISES))
def test_example_runs(name, capsys):
    _check(EXAMPLES / f"{name}.py", PROMISES[name], capsys)


@pytest.mark.parametrize("name", sorted(LEARNT))
def test_tutorial_runs(name, capsys):
    _check(TUTORIALS / f"{name}.py", LEARNT[name], capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PROMISES_LONG))
def test_long_example_runs(name, capsys):
    _check(EXAMPLES / f"{name}.py", PROMISES_LONG[name], capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(LEARNT_LONG))
def test_long_tutorial_runs(name, capsys):
    _check(TUTORIALS / f"{name}.py", LEARNT_LONG[name], capsys)


def test_a_tube_takes_at_most_25_lines():
    text = (EXAMPLES / "elastic_tube.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 25
