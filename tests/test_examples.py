"""Every example runs and prints what its title promises."""

import pathlib
import runpy

import jax
import pytest

EXAMPLES = pathlib.Path(__file__).parents[1] / "examples"
PROMISES = {
    "outlet": ["implicit step", "impedance", "mean flow", "Floquet"],
    "calibrate_patient": ["alpha", "closed form", "printed", "all"],
    "sweep_cohort": ["cases: 2000", "rest", "d alpha/d ratio"],
    "elastic_tube": ["mean pressure", "Ohm"],
    "wall_and_blood": ["Newtonian", "Carreau-Yasuda", "viscoelastic", "supported"],
    "ffr_interval": ["FFR 0.8", "chance of 0.80", "dilation", "of the variance"],
    "ffr_gradient": ["FFR under stress", "resting ratio", "with K"],
}


def test_every_example_is_tested():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(PROMISES)


@pytest.mark.parametrize("name", sorted(PROMISES))
def test_example_runs(name, capsys):
    with jax.numpy_rank_promotion("allow"):  # the core multiplies fields by numbers of elements
        runpy.run_path(str(EXAMPLES / f"{name}.py"))
    printed = capsys.readouterr().out
    for words in PROMISES[name]:
        assert words in printed
    assert "nan" not in printed
