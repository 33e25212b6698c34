import numpy as np

from study.stages import Stages, stage_key


def test_value_is_computed_once_and_again_for_other_inputs(tmp_path):
    stages, calls = Stages(tmp_path / "stages"), []

    def compute():
        calls.append(1)
        return {"x": 0.1 + 0.2, "pair": (1, 2)}

    key = stage_key("a", 1.0)
    first = stages.value("one", key, compute)
    assert first == stages.value("one", key, compute)
    assert first["x"] == 0.1 + 0.2  # JSON keeps every bit
    assert len(calls) == 1
    stages.value("one", stage_key("a", 1.5), compute)
    assert len(calls) == 2


def test_arrays_come_back_bit_for_bit_and_damage_is_mended(tmp_path):
    stages = Stages(tmp_path)
    arrays = {"a": np.random.default_rng(0).standard_normal((3, 4))}
    key = stage_key("arrays")
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
