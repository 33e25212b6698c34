"""`import-record`: files of every console become a record, or one sentence says why not."""

import importlib
import json
import pathlib
import tomllib

import numpy as np
import pytest

from study import read_case
from study.case.record import read_record
from tests.study.catheter_minutes import KEPT, REFUSED, export, minute

MMHG = 1333.22


def _written(folder: pathlib.Path, name: str, text: str) -> pathlib.Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


@pytest.fixture(scope="module")
def text() -> str:
    return export(minute(0).columns)


@pytest.mark.parametrize("kind", KEPT)
def test_record_of_an_unusual_or_damaged_file(command, tmp_path, text, kind, monkeypatch):
    if kind != "as it is":  # one picture has its text set and is painted, which takes longest

        def blank(_, path, **options):
            pathlib.Path(path).write_bytes(b"\x89PNG")

        monkeypatch.setattr("matplotlib.figure.Figure.savefig", blank)
    path = _written(tmp_path, "p_rest.csv", KEPT[kind](text))
    ended = command("import-record", path, "--json", folder=tmp_path / "out")
    assert ended.status == 0, ended.stderr
    record, _ = read_record(tmp_path / "out")
    (c,) = record.conditions
    truth = minute(0)
    assert c.period == pytest.approx(truth.period, rel=0.01)
    assert c.mean_P_aorta / MMHG == pytest.approx(truth.mean["P_aorta"], abs=0.4)
    drift = 1.5 if kind == "drift" else 0.0
    assert c.mean_P_distal / MMHG == pytest.approx(truth.mean["P_distal"] + drift, abs=0.4)
    assert len(c.beats["P_aorta"]) > 30
    assert (tmp_path / "out" / "beats.png").read_bytes()[:4] == b"\x89PNG"
    assert json.loads(ended.stdout)["conditions"][0]["beats_used"] > 30


@pytest.mark.parametrize("kind", REFUSED)
def test_one_sentence_refuses_a_file_of_no_use_and_nothing_is_written(
    command, tmp_path, text, kind
):
    damage, word = REFUSED[kind]
    path = _written(tmp_path, "p_rest.csv", damage(text))
    ended = command("import-record", path, folder=tmp_path / "out")
    assert ended.status == 2, ended.stdout
    assert word in ended.stderr
    assert ended.stderr.startswith("the input was refused: 1 fault\n")
    assert ended.stderr.count("\n") == 3
    assert not (tmp_path / "out").exists()


def test_a_record_does_not_replace_an_export(command, tmp_path, text):
    path = _written(tmp_path, "rest.csv", text)
    ended = command("import-record", path, folder=tmp_path)
    assert ended.status == 2
    assert f"{path}: --out = " in ended.stderr
    assert "name another folder with --out" in ended.stderr
    assert path.read_bytes() == text.encode()
    assert [found.name for found in tmp_path.iterdir()] == ["rest.csv"]


def test_unit_and_columns_of_the_command_line_mend_what_was_refused(command, tmp_path, text):
    path = _written(tmp_path, "p.csv", REFUSED["kPa"][0](text).split("\n", 1)[1])
    columns = "time=0,aortic=1,distal=2"
    ended = command(
        "import-record", f"rest={path}", "--unit", "kPa", "--columns", columns, "--span",
        "rest=10:50", "--id", "child-7", folder=tmp_path / "out",
    )  # fmt: skip
    assert ended.status == 0, ended.stderr
    record, _ = read_record(tmp_path / "out")
    assert record.id == "child-7"
    assert record.conditions[0].mean_P_aorta / MMHG == pytest.approx(
        minute(0).mean["P_aorta"], abs=0.6
    )


def test_twelve_seconds_as_a_console_writes_them(command, tmp_path):
    given = minute(3, seconds=12.0, ectopics=0.0, delay=0.06, respiration=1.0)
    kilopascal = {
        "Zeit [s]": given.columns["time"],
        "Pa [kPa]": 0.1333224 * given.columns["p_aortic"],
        "Pd [kPa]": 0.1333224 * given.columns["p_distal"],
    }
    text = "Klinik;Labor 2\nPatient;7\n\n" + export(kilopascal, separator=";", decimal=",")
    path = tmp_path / "p_rest.txt"
    path.write_bytes(text.encode("utf-16"))
    ended = command("import-record", path, "--json", folder=tmp_path / "out")
    assert ended.status == 0, ended.stderr
    (found,) = ended.json["conditions"]
    assert found["beats_used"] >= 12
    assert found["period_s"] == pytest.approx(given.period, rel=0.01)
    assert found["mean_P_aorta_mmHg"] == pytest.approx(given.mean["P_aorta"], abs=0.6)
    assert found["delay_s"] == pytest.approx(0.06, abs=0.004)
    assert any("60 ms later" in line and "not corrected" in line for line in found["remarks"])
    assert any("from kPa" in line for line in found["remarks"])
    # the traces themselves are as they were: the shift is still in the record
    rows = np.loadtxt(tmp_path / "out" / "rest.csv", delimiter=",", skiprows=1)
    known = set(np.round(given.columns["p_distal"], 1))
    assert np.mean([round(v, 1) in known for v in rows[:50, 2]]) > 0.9


def test_three_conditions_and_a_check_of_the_wire(command, tmp_path):
    files = []
    for k, (name, ratio, period) in enumerate(
        [("rest", 0.92, 0.8), ("ade", 0.86, 0.7), ("dobu", 0.82, 0.5), ("equal", 1.0, 0.7)]
    ):
        columns = minute(k, ratio=ratio, period=period, seconds=40.0).columns
        if name == "equal":
            columns["p_distal"] += 2.0
        files.append(_written(tmp_path, f"p7_{name}.csv", export(columns)))
    ended = command("import-record", *files, folder=tmp_path / "out")
    assert ended.status == 0, ended.stderr
    assert "The wire reads +" in ended.stdout
    record, _ = read_record(tmp_path / "out")
    assert record.id == "p7"
    assert [c.name for c in record.conditions] == ["rest", "adenosine", "dobutamine"]
    assert [c.order for c in record.conditions] == [0, 1, 2]
    assert record.pressure_offset_sd / MMHG == pytest.approx(2.0, abs=0.3)
    for c, ratio in zip(record.conditions, (0.92, 0.86, 0.82), strict=True):
        assert c.ffr == pytest.approx(ratio, abs=0.005)
        assert c.folding is not None
    tables = tomllib.loads((tmp_path / "out" / "conditions.toml").read_text())
    assert list(tables["condition"]) == ["rest", "adenosine", "dobutamine"]


def test_conditions_stand_in_a_case_file(command, tmp_path, text):
    path = _written(tmp_path, "p_rest.csv", text)
    assert command("import-record", path, folder=tmp_path / "out").status == 0
    conditions = (tmp_path / "out" / "conditions.toml").read_text()
    case = tmp_path / "out" / "case.toml"
    case.write_text(f'[patient]\nid = "p"\n[surrogate]\nR0_mmHg_s_per_ml = 3.0\n{conditions}')
    rest = read_case(case).conditions["rest"]
    assert rest.ffr == pytest.approx(0.9, abs=0.01)
    assert rest.waveform is not None
    P = np.array(rest.waveform.P_aorta) / MMHG
    assert P.argmin() in (0, 1, P.size - 1, P.size - 2)
    assert P.mean() == pytest.approx(minute(0).mean["P_aorta"], abs=0.6)


def test_a_record_that_is_there_is_not_replaced(command, tmp_path, text):
    path = _written(tmp_path, "p_rest.csv", text)
    folder = tmp_path / "out"
    assert command("import-record", path, folder=folder).status == 0
    before = (folder / "record.toml").read_bytes()
    ended = command("import-record", path, folder=folder)
    assert ended.status == 2
    assert "exists already" in ended.stderr
    assert (folder / "record.toml").read_bytes() == before


def test_faults_of_several_files_are_told_together(command, tmp_path, text):
    good = _written(tmp_path, "p_rest.csv", text)
    bad = [
        _written(tmp_path, f"p_{name}.csv", REFUSED[kind][0](text))
        for name, kind in (("ade", "constant"), ("dobu", "empty"))
    ]
    ended = command("import-record", good, *bad, folder=tmp_path / "out")
    assert ended.status == 2
    assert "2 faults" in ended.stderr
    missing = command("import-record", tmp_path / "none_rest.csv", folder=tmp_path / "out")
    assert missing.status == 2
    assert "No such file" in missing.stderr


def _dicom():
    reason = "needs pydicom: pip install 'jaxfsi[dicom]'"
    pytest.importorskip("pydicom", reason=reason)
    return importlib.import_module("tests.study.dicom_minutes")


def test_a_dicom_file_gives_the_record_of_the_same_samples_as_text(command, tmp_path):
    dicom = _dicom()
    columns = minute(4, rate=200.0).columns
    waves = (
        dicom.Wave("II", np.zeros(columns["time"].size), unit="mV"),
        dicom.Wave("P1", columns["p_aortic"], source=("128444004", "Aortic pressure waveform")),
        dicom.Wave("P2", columns["p_distal"], modifiers=("Distal right coronary artery",)),
    )
    dicom.write_waveforms(tmp_path / "c_rest.dcm", dicom.Group(waves, rate=200.0))
    rounded = {
        "time": columns["time"],
        "p_aortic": dicom.decoded(waves[1]),
        "p_distal": dicom.decoded(waves[2]),
    }
    _written(tmp_path, "c_rest.csv", export(rounded))
    found = {}
    for suffix in ("dcm", "csv"):
        ended = command(
            "import-record", tmp_path / f"c_rest.{suffix}", "--json", folder=tmp_path / suffix
        )
        assert ended.status == 0, ended.stderr
        found[suffix] = ended.json["conditions"][0]
        # nothing of the patient but the name of the file
        written = [path.read_bytes() for path in (tmp_path / suffix).iterdir()]
        for word in ("Zweistein", "Frieda", "4711", "20101224", "20261101", "Curie"):
            assert word not in ended.stdout + ended.stderr
            assert not any(word.encode() in content for content in written)
    assert found["dcm"].keys() == found["csv"].keys()
    assert found["dcm"]["beats_used"] == found["csv"]["beats_used"]
    for key in ("period_s", "mean_P_aorta_mmHg", "mean_P_distal_mmHg", "ratio", "delay_s"):
        assert found["dcm"][key] == pytest.approx(found["csv"][key], rel=1e-6, abs=1e-6)
    rows = {
        suffix: np.loadtxt(tmp_path / suffix / "rest.csv", delimiter=",", skiprows=1)
        for suffix in found
    }
    # the text is rounded to 0.001 mmHg and 0.001 s
    np.testing.assert_allclose(rows["dcm"], rows["csv"], atol=1.1e-3)


def _ecg_only(dicom, columns):
    return dicom.Group((dicom.Wave("II", columns["p_aortic"], unit="mV"),))


def _pressures(dicom, columns, **aortic):
    distal = dicom.Wave("Pd", columns["p_distal"])
    return dicom.Group((dicom.Wave("Ao", columns["p_aortic"], **aortic), distal))


DAMAGED = {
    "ECG alone": (_ecg_only, "it holds no pressure; its channels are II (mV)"),
    "unknown unit": (
        lambda d, c: _pressures(d, c, unit="cm[H2O]"),
        "channel Ao: its unit is cm[H2O]; known are mm[Hg] and kPa",
    ),
    "no unit": (lambda d, c: _pressures(d, c, unit=None), "channel Ao: it has no unit"),
    "no sensitivity": (
        lambda d, c: _pressures(d, c, sensitivity=None),
        "channel Ao: it has no sensitivity (003A,0210)",
    ),
    "no rate": (
        lambda d, c: _pressures(d, c)._replace(rate=None),
        "no sampling frequency (003A,001A)",
    ),
}


@pytest.mark.parametrize("kind", [*DAMAGED, "truncated", "no DICOM", "another class", "--rate"])
def test_one_sentence_refuses_a_dicom_file_of_no_use(command, tmp_path, kind):
    dicom = _dicom()
    columns, path = minute(0, seconds=20.0).columns, tmp_path / "c_rest.dcm"
    make, word = DAMAGED.get(kind, (_pressures, ""))
    dicom.write_waveforms(path, make(dicom, columns))
    more = []
    if kind == "truncated":
        path.write_bytes(path.read_bytes()[:-3000])
        word = "it breaks off: 1250 of 2000 samples are there"
    elif kind == "no DICOM":
        path.write_text(export(columns))
        word = "this is no DICOM file"
    elif kind == "another class":
        ecg = "1.2.840.10008.5.1.4.1.1.9.1.2"
        dicom.write_waveforms(path, _ecg_only(dicom, columns), sop_class=ecg)
        word = "it is General ECG Waveform, not Hemodynamic Waveform"
    elif kind == "--rate":
        more, word = ["--rate", "100"], "--rate = 100: a DICOM file says its own times"
    ended = command("import-record", path, *more, folder=tmp_path / "out")
    assert ended.status == 2, ended.stdout
    assert word in ended.stderr
    assert ended.stderr.startswith("the input was refused: 1 fault\n")
    assert ended.stderr.count("\n") == 3
    assert not (tmp_path / "out").exists()


def test_without_pydicom_a_dicom_file_says_how_to_install_it(command, tmp_path, monkeypatch):
    path = tmp_path / "c_rest.dcm"
    path.write_bytes(b"\0" * 128 + b"DICM")
    monkeypatch.setattr("importlib.util.find_spec", lambda name, package=None: None)
    ended = command("import-record", path, folder=tmp_path / "out")
    assert ended.status == 2
    assert "need the package pydicom" in ended.stderr
    assert "pip install 'jaxfsi[dicom]'" in ended.stderr
