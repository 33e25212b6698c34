import numpy as np
import pytest

from study.faults import CaseError
from study.record_file import read_record, record_files
from tests.diagnosis.records import synthetic


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


def test_a_record_without_rest_is_read_with_a_remark(tmp_path, files):
    head, *parts = files["record.toml"].split("\n[[condition]]")
    text = "\n[[condition]]".join([head, *parts[1:]])
    _, remarks = read_record(write(tmp_path / "r", {**files, "record.toml": text}))
    assert any("no measurement at rest" in remark for remark in remarks)


def test_random_damage_never_crashes(tmp_path, files):
    rng = np.random.default_rng(5)
    names = list(files)
    for k in range(200):
        name = names[int(rng.integers(len(names)))]
        text = list(files[name])
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(len(text)))
            text[at] = str(rng.choice(list('0.-,=\n[]x" ')))
        try:
            read_record(write(tmp_path / "r", {**files, name: "".join(text)}))
        except CaseError as refusal:
            assert "try:" in str(refusal), k  # noqa: PT017
