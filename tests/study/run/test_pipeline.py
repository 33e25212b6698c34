"""The demo patient end to end: numbers of the result."""

import math

import pytest

from lumped import MMHG


def runs(result, **wanted):
    return [run for run in result["runs"] if wanted.items() <= run.items()]


def only(result, **wanted):
    (run,) = runs(result, **wanted)
    return run


@pytest.fixture(scope="module")
def result(demo):
    assert demo.status == 0, demo.stderr
    return demo.written()


def test_calibrated_rest_ratio_is_the_measured_one(result):
    for law in ("linear", "quadratic"):
        run = only(result, condition="rest", law=law, boundary="calibrated")
        # Newton's last step is quadratic: the residual is round-off of the march
        assert run["rest_ratio"] == pytest.approx(0.91, abs=1e-10)


def test_closed_form_newton_and_bisection_agree(result):
    linear, quadratic = (result["calibrations"][law] for law in ("linear", "quadratic"))
    # bisection stops at 1e-12 of log alpha; the others at round-off
    assert linear["alpha"] == pytest.approx(linear["closed_form"], rel=1e-11)
    assert linear["alpha"] == pytest.approx(linear["bisection"], rel=1e-9)
    assert quadratic["alpha"] == pytest.approx(quadratic["bisection"], rel=1e-8)
    assert quadratic["closed_form"] is None


def test_linear_ffr_under_stress_is_the_divider(result):
    model, bed = result["models"]["linear"], result["coronary"]
    for rule, factor in (("printed", {"R_2": 0.5}), ("all", dict.fromkeys(bed, 0.5))):
        for run in runs(result, law="linear", rule=rule):
            total = run["alpha"] * sum(bed[n] * factor.get(n, 1.0) for n in ("R_1", "R_2", "R_3"))
            # the theorem holds to round-off of a small direct solve
            assert run["ffr"] == pytest.approx(total / (model["R0"] + total), rel=1e-12)


def test_every_condition_has_both_rules_laws_and_outlets(result):
    settings = {(r["condition"], r["law"], r["rule"], r["boundary"]) for r in result["runs"]}
    laws, outlets = ("linear", "quadratic"), ("fixed", "calibrated")
    expected = {("rest", law, None, outlet) for law in laws for outlet in outlets}
    expected |= {
        (name, law, rule, outlet)
        for name in ("dobutamine", "adenosine")
        for law in laws
        for rule in ("printed", "all")
        for outlet in outlets
    }
    assert settings == expected
    assert len(result["runs"]) == len(expected)


def test_ratio_is_named_after_its_condition(result):
    for run in result["runs"]:
        assert ("rest_ratio" in run) == (run["condition"] == "rest")
        assert ("ffr" in run) == (run["condition"] != "rest")


def test_means_of_the_waveforms_give_the_ratio(result):
    for run, wave in zip(result["runs"], result["waveforms"], strict=True):
        tuned = result["calibrations"][run["law"]]["alpha"]
        assert run["alpha"] == (1.0 if run["boundary"] == "fixed" else pytest.approx(tuned))
        period = result["conditions"][run["condition"]]["period_s"]
        t = [*wave["t_s"], period]
        ratio = mean(t, wave["P_distal_mmHg"]) / mean(t, wave["P_aorta_mmHg"])
        # trapezoidal rule on the graded time points, against exact means
        assert ratio == pytest.approx(run.get("ffr", run.get("rest_ratio")), abs=1e-3)


def mean(t, values):
    closed = [*values, values[0]]
    area = sum(0.5 * (closed[k] + closed[k + 1]) * (t[k + 1] - t[k]) for k in range(len(t) - 1))
    return area / (t[-1] - t[0])


def test_resistance_comes_from_the_contours(result):
    linear, quadratic = result["models"]["linear"], result["models"]["quadratic"]
    assert "40 mmHg" in linear["origin"]
    # tangent of a Q + b Q² at ΔP: √(a² + 4 b ΔP)
    tangent = math.sqrt(quadratic["R0"] ** 2 + 4.0 * quadratic["K"] * 40.0 * MMHG)
    assert linear["R0"] == pytest.approx(tangent, rel=1e-12)
    parts = [
        result["vessel"][n] for n in ("b_contraction", "b_development", "b_expansion", "b_head")
    ]
    assert sum(parts) == pytest.approx(quadratic["K"], rel=1e-12)


def test_aortic_windkessel_follows_from_output_and_stroke_volume(result):
    block = result["conditions"]["rest"]["aortic_windkessel"]
    flow = 5.6 * 1000.0 / 60.0
    assert block["R_s"] == pytest.approx((2.0 * 75.0 + 120.0) / 3.0 * MMHG / flow, rel=1e-12)
    assert block["C_s"] == pytest.approx(80.0 / (45.0 * MMHG), rel=1e-12)
    assert result["conditions"]["adenosine"]["aortic_windkessel"] is None


def test_recalibrated_linear_ffr_does_not_feel_the_artery(result):
    for entry in result["sensitivities"]:
        if entry["law"] == "linear" and entry["condition"] != "rest":
            # alpha ∝ R0 at a fixed resting ratio; round-off of a small direct solve
            assert abs(entry["recalibrated"]["R0"]) < 1e-10
            assert entry["at_fixed_alpha"]["R0"] < -0.01


def test_implausible_flow_of_the_quadratic_law_is_said(result):
    warnings = [note["text"] for note in result["notes"] if note["level"] == "warning"]
    assert any("resting flow" in text and "quadratic" in text for text in warnings)
    assert any('"printed"' in text and "too high" in text for text in warnings)


def test_fixed_outlet_is_compared_with_the_measurement(result):
    run = only(result, condition="rest", law="linear", boundary="fixed")
    assert run["gap"]["difference"] == pytest.approx(run["rest_ratio"] - 0.91, rel=1e-12)
    assert run["gap"]["p"] < 0.01
    assert (
        only(result, condition="dobutamine", law="linear", rule="all", boundary="fixed")["gap"]
        is None
    )


def test_provenance_names_inputs_versions_and_command(result):
    made = result["provenance"]
    names = [entry["file"] for entry in made["inputs"]]
    assert names[:4] == [
        "case.toml", "rest_diastole_contours.csv", "rest_frames.csv", "rest_diastole_reference.csv",
    ]  # fmt: skip
    assert "centerline.csv" in names
    assert len(set(names)) == len(names)
    assert all(len(entry["sha256"]) == 64 for entry in made["inputs"])
    assert made["command"][:3] == ["jaxfsi", "run", "--demo"]
    assert made["versions"]["jax"]


def test_json_is_one_object_with_nothing_around_it(demo):
    assert demo.json["patient"] == "anomalous-rca-ivus"
    assert "waveforms" not in demo.json
    assert [name.rsplit("/")[-1] for name in demo.json["files"]] == ["report.html", "result.json"]
    assert sorted(path.name for path in demo.folder.iterdir()) == [
        "report.html",
        "result.json",
        "run.log",
    ]
