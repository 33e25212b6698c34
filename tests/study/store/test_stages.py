import dataclasses
import json
import pathlib

import numpy as np
import pytest

import study.store.numerics as numerics
from study.store.stages import PartOfStage, Stages, stage_key


def test_value_is_computed_once_and_again_for_other_inputs(tmp_path):
    stages, calls = Stages(tmp_path / "stages"), []

    def compute():
        calls.append(1)
        return {"x": 0.1 + 0.2, "pair": (1, 2)}

    key = stage_key("run", 1.0)
    first = stages.value("one", key, compute)
    assert first == stages.value("one", key, compute)
    assert first["x"] == 0.1 + 0.2  # JSON keeps every bit
    assert len(calls) == 1
    stages.value("one", stage_key("run", 1.5), compute)
    assert len(calls) == 2


def test_arrays_come_back_bit_for_bit_and_damage_is_mended(tmp_path):
    stages = Stages(tmp_path)
    arrays = {"a": np.random.default_rng(0).standard_normal((3, 4))}
    key = stage_key("ramp")
    stages.arrays("run", key, lambda: arrays)
    found = stages.arrays("run", key, lambda: {})
    np.testing.assert_array_equal(found["a"], arrays["a"])
    (tmp_path / "run.npz").write_bytes(b"half")
    assert "b" in stages.arrays("run", key, lambda: {"b": np.zeros(2)})


def test_stage_that_fails_leaves_nothing(tmp_path):
    stages = Stages(tmp_path)

    def fail():
        raise RuntimeError("no")

    try:
        stages.value("one", "key", fail)
    except RuntimeError:
        pass
    assert stages.known("one", "key") is None
    assert not list(tmp_path.iterdir())


def test_part_of_a_stage_is_found_whole_or_not_at_all(tmp_path):
    stages = Stages(tmp_path)
    part = PartOfStage(stages, "part", "key")
    part.save({"a": np.arange(3.0)})
    found = part.load()
    assert found is not None
    assert found.keys() == {"a"}
    np.testing.assert_array_equal(found["a"], np.arange(3.0))
    assert PartOfStage(stages, "part", "another key").load() is None
    path = tmp_path / "part.npz"
    np.savez_compressed(path, key=np.array("key"), a=np.zeros(2**22))  # 32 MB in 32 kB
    assert part.load() is None
    part.drop()
    part.drop()
    assert not path.exists()


@pytest.mark.parametrize("value", [None, False, 0, "", []])
def test_value_that_is_none_or_false_is_kept_too(tmp_path, value):
    stages, calls = Stages(tmp_path), []

    def compute():
        calls.append(1)
        return value

    key = stage_key("run")
    for _ in range(2):
        assert stages.value("one", key, compute) == value
    assert len(calls) == 1
    assert stages.known("one", key) is not None


def test_stage_says_when_and_by_which_code_it_was_made(tmp_path):
    stages, key = Stages(tmp_path), stage_key("ramp")
    stages.value("one", key, lambda: 1)
    stages.arrays("two", key, lambda: {"a": np.zeros(2)})
    for name in ("one", "two"):
        made = stages.made(name)
        assert made is not None
        assert made["date"].startswith("20")
        assert {"version", "commit", "libraries"} <= made.keys()
        assert made["numerics"]["march"] == numerics.version("march")
    assert stages.made("three") is None


def test_stage_of_an_older_format_is_computed_again(tmp_path):
    key = stage_key("run")
    (tmp_path / "one.json").write_text(json.dumps({"key": key, "value": 1}))
    np.savez(tmp_path / "two.npz", key=np.array(key), a=np.zeros(2))
    stages = Stages(tmp_path)
    assert stages.made("one") is None
    assert stages.value("one", key, lambda: 2) == 2
    assert stages.arrays("two", key, lambda: {"a": np.ones(2)})["a"].sum() == 2.0


@dataclasses.dataclass(frozen=True)
class _Choice:
    dt: float = 1e-3


def test_key_knows_no_order_of_a_table_no_folder_and_no_field_that_is_left_out():
    key = stage_key("run", {"a": 1.0, "b": 2.0}, pathlib.Path("/here/beat.csv"), _Choice())
    assert key == stage_key("run", {"b": 2.0, "a": 1.0}, pathlib.Path("/there/beat.csv"), _Choice())
    later = dataclasses.make_dataclass("_Choice", [("dt", float), ("rule", str, None)], frozen=True)
    assert key == stage_key("run", {"a": 1.0, "b": 2.0}, pathlib.Path("beat.csv"), later(1e-3))
    assert key != stage_key("run", {"a": 1.0, "b": 2.0}, pathlib.Path("beat.csv"), later(1e-3, "x"))


def test_key_knows_every_number_of_a_long_array():
    wave = np.sin(np.arange(5000.0))
    moved = wave.copy()
    moved[2500] += 1e-9
    assert stage_key("run", wave) == stage_key("run", wave.copy())
    assert stage_key("run", wave) != stage_key("run", moved)
    with pytest.raises(TypeError, match="no key"):
        stage_key("run", object())


def _kept(tmp_path, kind="run"):
    """How often a stage is computed when it is asked for again."""
    calls = []
    Stages(tmp_path).value("one", stage_key(kind), lambda: calls.append(1))
    return len(calls)


@pytest.mark.parametrize("part", ["march", "0D"])
def test_stage_is_computed_again_under_other_numerics(tmp_path, monkeypatch, part):
    assert (_kept(tmp_path), _kept(tmp_path)) == (1, 0)
    real = numerics.version
    monkeypatch.setattr(numerics, "version", lambda p: "raised" if p == part else real(p))
    assert (_kept(tmp_path), _kept(tmp_path)) == (1, 0)
    monkeypatch.undo()
    assert _kept(tmp_path) == 1


def test_stage_outlives_a_change_of_numerics_that_do_not_decide_it(tmp_path, monkeypatch):
    assert _kept(tmp_path) == 1
    real = numerics.version
    others = ("diagnosis", "mesh report", "reading", "case")
    monkeypatch.setattr(numerics, "version", lambda p: "raised" if p in others else real(p))
    assert _kept(tmp_path) == 0


@pytest.mark.parametrize("name", ["jax", "jaxlib", "numpy", "scipy", "equinox"])
def test_stage_is_computed_again_with_another_library(tmp_path, monkeypatch, name):
    assert _kept(tmp_path) == 1
    real = numerics.library
    monkeypatch.setattr(numerics, "library", lambda n: "99.0" if n == name else real(n))
    assert _kept(tmp_path) == 1


def test_stage_is_computed_again_in_another_precision_or_on_another_device(tmp_path, monkeypatch):
    assert _kept(tmp_path) == 1
    monkeypatch.setattr(numerics, "arithmetic", lambda: "32 bits, gpu")
    assert _kept(tmp_path) == 1


def test_kept_value_that_cannot_be_read_is_computed_again(tmp_path):
    stages = Stages(tmp_path)
    stages.keep("run", "key", {"alpha": "none"})

    def read(value):
        return float(value["alpha"])

    assert stages.value("run", "key", lambda: {"alpha": 0.1}, read) == 0.1
    assert stages.value("run", "key", lambda: pytest.fail("computed"), read) == 0.1
