import json
import math
from collections import defaultdict

import numpy as np
import pytest

from diagnosis import diagnose, measured, noise_of, stacked
from lumped import MMHG
from study.case.faults import CaseError
from study.case.record import read_record, record_files
from study.case.record_beats import read_beats
from study.run.diagnosis import with_case
from study.store.layouts import FORMAT
from tests.diagnosis.records import synthetic
from tests.study.damage import damaged


@pytest.fixture(scope="module")
def files():
    return record_files(synthetic({}))


def write(folder, files):
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def changed(files, name, old, new):
    assert old in files[name]
    return {**files, name: files[name].replace(old, new, 1)}


def test_a_written_record_is_read_back(tmp_path, files):
    record, remarks = read_record(write(tmp_path / "r", files))
    assert [c.name for c in record.conditions][-1] == "dobutamine_high"
    assert record_files(record) == files
    assert remarks == ()


def column(files, name, k, change):
    rows = [row.split(",") for row in files[name].strip().split("\n")]
    for row in rows[1:]:
        row[k] = repr(change(float(row[k])))
    return {**files, name: "\n".join(",".join(row) for row in rows) + "\n"}


def swapped(files, name):
    rows = [row.split(",") for row in files[name].strip().split("\n")]
    body = [",".join([t, b, a]) for t, a, b in rows[1:]]
    return {**files, name: "\n".join([",".join(rows[0]), *body]) + "\n"}


DAMAGE = {
    "missing": (lambda f: changed(f, "rest.csv", "P_aorta_mmHg", "P_unknown"), "unknown column"),
    "unit": (lambda f: changed(f, "rest.csv", "P_aorta_mmHg", "P_aorta_kPa"), "convert the column"),
    "nan": (lambda f: changed(f, "rest.csv", "\n0,", "\nnan,"), "not a row of finite"),
    "clip": (lambda f: column(f, "rest.csv", 1, lambda v: min(v, 95.0)), "is clipped"),
    "swap": (lambda f: swapped(f, "dobutamine.csv"), "mean|distal"),
    "kPa": (lambda f: column(f, "rest.csv", 1, lambda v: v / 7.5), "aorti|plausible"),
    "key": (lambda f: changed(f, "record.toml", "period_s", "period_ms"), "period_s"),
    "flow": (lambda f: changed(f, "record.toml", "mean_flow_ml_per_min = ",
                               "mean_flow_ml_per_min = -"), "mean_flow_ml_per_min"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_records_are_refused_with_a_cause(name, tmp_path, files):
    damage, words = DAMAGE[name]
    with pytest.raises(CaseError, match=words):
        read_record(write(tmp_path / name, damage(files)))


def peak_at(share, period):
    """Two beats whose aortic peak lies at a share of the beat, as a table in a file."""
    t = np.arange(100) * period / 50
    P = 80.0 + 30.0 * np.cos(2.0 * np.pi * (t / period - share)) + 0.2 * np.cos(40.0 * t)
    rows = [f"{a:.6f},{b:.4f}" for a, b in zip(t, P, strict=True)]
    return "\n".join(["time_s,P_aorta_mmHg", *rows]) + "\n"


@pytest.mark.parametrize(
    ("share", "period", "fits"), [(0.56, 0.335, True), (0.56, 0.8, False), (0.75, 0.335, False)]
)
def test_ejection_of_a_fast_heart_is_more_than_half_of_its_beat(share, period, fits, tmp_path):
    path = tmp_path / "beats.csv"
    path.write_text(peak_at(share, period))
    faults = []
    found = read_beats(path, period, 110.0, "waveform", faults)
    told = [fault for fault in faults if "ejection" in str(fault)]
    assert (not told) == fits
    assert (found is not None) == fits


def test_two_conditions_of_one_place_are_refused(tmp_path, files):
    same = changed(files, "record.toml", "order = 1\n", "order = 0\n")
    with pytest.raises(CaseError, match=r"order = 0: condition\.rest has this place too"):
        read_record(write(tmp_path / "r", same))


def test_a_record_without_rest_is_read_with_a_remark(tmp_path, files):
    head, *parts = files["record.toml"].split("\n[condition.")
    text = "\n[condition.".join([head, *parts[1:]])
    _, remarks = read_record(write(tmp_path / "r", {**files, "record.toml": text}))
    assert any("no measurement at rest" in remark for remark in remarks)


def test_random_damage_never_crashes(tmp_path, files):
    rng = np.random.default_rng(5)
    refused = 0
    for k in range(200):
        try:
            read_record(write(tmp_path / f"r{k}", damaged(rng, files)))
        except CaseError as refusal:
            assert "try:" in str(refusal), k  # noqa: PT017
            refused += 1
    assert 60 < refused < 200


@pytest.mark.slow
def test_damaged_records_that_are_accepted_are_diagnosed(tmp_path, files):
    rng = np.random.default_rng(5)
    groups = defaultdict(list)
    for k in range(200):
        try:
            record, _ = read_record(write(tmp_path / f"r{k}", damaged(rng, files)))
        except CaseError:
            continue
        one = measured(record)
        groups[one.n_conditions, one.n_sensors].append(one)
    for records in groups.values():
        for found in diagnose(stacked(records)):
            p = found.judgement.probabilities
            assert sum(p.values()) == pytest.approx(1.0, abs=1e-9)
            assert all(math.isfinite(v) for v in found.log_B.values())


def test_a_stated_offset_is_used(tmp_path, files):
    toml = files["record.toml"].replace("[noise]", "[noise]\npressure_offset_sd_mmHg = 0.2", 1)
    record, _ = read_record(write(tmp_path / "r", {**files, "record.toml": toml}))
    assert noise_of(record).offset_sd == pytest.approx(0.2 * MMHG)


def test_a_known_curve_is_read_and_written_again_and_needs_its_R0(tmp_path, files):
    line = next(x for x in files["record.toml"].split("\n") if x.startswith("R0_mmHg"))
    curve = "K_mmHg_s2_per_ml2 = 0.75\nL_mmHg_s2_per_ml = 0.03"
    toml = files["record.toml"].replace(line, f"{line}\n{curve}")
    record, _ = read_record(write(tmp_path / "r", {**files, "record.toml": toml}))
    assert (record.K, record.L) == pytest.approx((0.75 * MMHG, 0.03 * MMHG), rel=1e-12)
    assert read_record(write(tmp_path / "again", record_files(record)))[0].K == record.K
    one = measured(record)
    assert float(one.K) == record.K
    alone = toml.replace(line, "")
    with pytest.raises(CaseError, match="R0 is missing"):
        read_record(write(tmp_path / "alone", {**files, "record.toml": alone}))


def test_R0_comes_from_the_ramp_of_a_finished_study(tmp_path, files):
    record, _ = read_record(write(tmp_path / "r", files))
    rest = record.conditions[0].beats
    drop = float(rest["P_aorta"].mean() - rest["P_distal"].mean())
    ramp = {"a": 2.0, "b": 1.5, "inertance": 0.03, "tangent_40_mmHg": 15.6}
    ramp = {key: value * MMHG for key, value in ramp.items()}
    document = {"format": FORMAT, "kind": "study", "ramp": ramp}
    (tmp_path / "study.json").write_text(json.dumps(document))
    changed, remark = with_case(record, tmp_path)
    assert (changed.R0, changed.K, changed.L) == pytest.approx(
        (ramp["a"], ramp["b"], ramp["inertance"])
    )
    assert "curve" in remark
    ramp["a"] = -0.1 * MMHG  # no curve that a surrogate could take
    (tmp_path / "study.json").write_text(json.dumps(document))
    changed, remark = with_case(record, tmp_path)
    Q = drop / changed.R0
    assert ramp["a"] * Q + ramp["b"] * Q**2 == pytest.approx(drop)
    assert changed.K is None
    assert "secant" in remark
    del document["ramp"]
    (tmp_path / "study.json").write_text(json.dumps(document))
    with pytest.raises(CaseError, match="no study with a ramp"):
        with_case(record, tmp_path)


def test_case_of_another_patient_is_told(tmp_path, files):
    record, _ = read_record(write(tmp_path / "r", files))
    for name, said in ((record.id, False), ("other-patient", True)):
        case = tmp_path / "case.toml"
        case.write_text(
            f'[patient]\nid = "{name}"\n[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3\n'
            "[condition.rest]\nP_systolic_mmHg = 110.0\nP_diastolic_mmHg = 65.0\nperiod_s = 0.8\n"
        )
        assert ("other-patient" in with_case(record, case)[1]) == said


def test_R0_comes_from_the_contours_of_a_case_without_a_study(tmp_path, files):
    record, _ = read_record(write(tmp_path / "r", files))
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    radius, length = 1.2, 12.0  # mm
    rows = [
        f"{k},{radius * np.cos(a):.6f},{radius * np.sin(a):.6f},{z}"
        for k, z in enumerate(np.linspace(0.0, length, 13))
        for a in angle
    ]
    (tmp_path / "contours.csv").write_text("\n".join(rows) + "\n")
    case = tmp_path / "case.toml"
    case.write_text(
        f'[patient]\nid = "{record.id}"\n[anatomy]\nkind = "ivus"\ncontours = "contours.csv"\n'
        "[condition.rest]\nP_systolic_mmHg = 110.0\nP_diastolic_mmHg = 65.0\nperiod_s = 0.8\n"
    )
    changed, remark = with_case(record, case)
    poiseuille = 8.0 * 0.035 * 0.1 * length / (np.pi * (0.1 * radius) ** 4)
    # 13 frames stand for 12 mm, or one spacing more
    assert changed.R0 == pytest.approx(poiseuille, rel=0.2)
    assert changed.K is not None
    assert changed.K > 0.0
    assert "contours" in remark
