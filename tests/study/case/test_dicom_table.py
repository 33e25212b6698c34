"""DICOM files of haemodynamic waveforms: the samples, times and units that they state."""

import pathlib

import numpy as np
import pytest

pytest.importorskip("pydicom", reason="needs pydicom: pip install 'jaxfsi[dicom]'")

from study import CaseError
from study.case.catheter.columns import ExportFormat
from study.case.catheter.samples import CatheterTrace
from study.case.catheter.trace import read_trace
from tests.study.catheter_minutes import minute
from tests.study.dicom_minutes import Group, Wave, decoded, waveform_file, write_waveforms

AS_IT_IS = ExportFormat()


@pytest.fixture(scope="module")
def samples() -> dict[str, np.ndarray]:
    return minute(0).columns


def read(folder: pathlib.Path, *groups: Group, given: ExportFormat = AS_IT_IS) -> CatheterTrace:
    path = folder / "x_rest.dcm"
    write_waveforms(path, *groups)
    return read_trace(path, given)


def pair(samples: dict[str, np.ndarray], **aortic) -> tuple[Wave, Wave]:
    return Wave("Ao", samples["p_aortic"], **aortic), Wave("Pd", samples["p_distal"])


def test_sensitivity_correction_and_baseline_give_the_pressures(tmp_path, samples):
    waves = pair(samples, sensitivity=0.1, correction=0.8, baseline=100.0)
    trace = read(tmp_path, Group(waves))
    np.testing.assert_allclose(trace.waves["P_aorta"], decoded(waves[0]), atol=1e-9)
    # half a step of the encoding is the most by which a sample is rounded
    assert np.abs(trace.waves["P_aorta"] - samples["p_aortic"]).max() <= 0.04 + 1e-9
    np.testing.assert_allclose(trace.t, samples["time"], atol=1e-9)
    assert trace.columns == {"time": "time", "aortic": "Ao", "distal": "Pd"}


def test_absent_correction_and_baseline_are_told(tmp_path, samples):
    trace = read(tmp_path, Group(pair(samples, correction=None, baseline=None)))
    assert np.abs(trace.waves["P_aorta"] - samples["p_aortic"]).max() <= 0.025 + 1e-9
    assert trace.remarks == (
        "Ao has no correction factor: 1 is taken.",
        "Ao has no baseline: 0 is taken.",
    )


@pytest.mark.parametrize(
    ("source", "modifiers"),
    [
        (("128444004", "Forme d'onde de la pression aortique"), ()),
        (("128433007", "Hemodynamic pressure waveform"), ("Ascending aorta",)),
        (("0", "Aortic pressure waveform"), ()),
    ],
)
def test_coded_sources_say_which_channel_is_which(tmp_path, samples, source, modifiers):
    aortic = Wave("P1", samples["p_aortic"], source=source, modifiers=modifiers)
    modified = ("Distal right coronary artery",)
    distal = Wave("", samples["p_distal"], modifiers=modified)
    trace = read(tmp_path, Group((distal, aortic)))
    np.testing.assert_allclose(trace.waves["P_aorta"], decoded(aortic), atol=1e-9)
    assert trace.columns["aortic"] == "P1"
    assert trace.columns["distal"] == "Hemodynamic pressure waveform, Distal right coronary artery"


def test_columns_are_mapped_by_number_and_by_name(tmp_path, samples):
    waves = (
        Wave("P1", samples["p_distal"]),
        Wave("art 2", samples["p_aortic"]),
        Wave("II", samples["p_aortic"], unit="mV"),
    )
    for columns in ({"aortic": "2", "distal": "1"}, {"aortic": "art 2", "distal": "p1"}):
        trace = read(tmp_path, Group(waves), given=ExportFormat(columns))
        np.testing.assert_allclose(trace.waves["P_aorta"], decoded(waves[1]), atol=1e-9)
    assert "Channels not read: II." in trace.remarks
    with pytest.raises(CaseError, match="the columns are 0: time, 1: P1, 2: art 2"):
        read(tmp_path, Group(waves))


def test_kilopascal_by_its_code(tmp_path, samples):
    waves = tuple(
        Wave(name, 0.1333224 * samples[key], unit="kPa", sensitivity=0.002)
        for name, key in (("Ao", "p_aortic"), ("Pd", "p_distal"))
    )
    trace = read(tmp_path, Group(waves))
    # half a step of 0.002 kPa is 0.0075 mmHg; the units are known to 3e-6
    assert np.abs(trace.waves["P_distal"] - samples["p_distal"]).max() < 0.0080
    assert "Pressures were converted from kPa to mmHg." in trace.remarks


def test_groups_of_different_rates_meet_at_the_slower_pressure(tmp_path, samples):
    ecg = Group((Wave("II", np.zeros(60_000), unit="mV"),), rate=1000.0)
    groups = (
        ecg,
        Group((Wave("Ao", np.sin(np.arange(30_000) / 80.0) * 20.0 + 90.0),), rate=500.0),
        Group((Wave("Pd", samples["p_distal"]),), rate=100.0, offset=120.0),
    )
    trace = read(tmp_path, *groups)
    assert trace.step == pytest.approx(0.01)
    at = 0.12 + trace.t  # 0 s is the first common sample
    np.testing.assert_allclose(
        trace.waves["P_aorta"], np.sin(at * 500.0 / 80.0) * 20.0 + 90.0, atol=0.03
    )
    np.testing.assert_allclose(
        trace.waves["P_distal"], decoded(groups[2].waves[0])[: trace.t.size], atol=1e-9
    )
    assert trace.t.size == 5988  # the last 0.12 s have no aortic pressure
    assert any("500 samples a second, the distal one 100" in said for said in trace.remarks)


@pytest.mark.parametrize(
    "late",
    [
        {"skew": 0.004},
        {"skew": None, "sample_skew": 0.4},
        {"offset": 0.004},
    ],
)
def test_skew_and_offset_shift_the_times_of_a_channel(tmp_path, late):
    t = np.arange(0.0, 30.0, 0.01)
    waves = (
        Wave("Ao", 90.0 + 20.0 * np.sin(7.0 * t)),
        Wave("Pd", 85.0 + 20.0 * np.sin(7.0 * (t + 0.004)), **late),
    )
    trace = read(tmp_path, Group(waves))
    # the same sine at the same times, but for rounding (0.025 mmHg each) and the line between two
    # samples (h²/8 · 980 mmHg/s² = 0.012 mmHg); without the shift they differ by 0.56 mmHg
    off = trace.waves["P_aorta"] - trace.waves["P_distal"]
    assert np.abs(off - 5.0).max() < 0.063
    assert any("4 ms later" in said for said in trace.remarks)


def test_padding_counts_as_lost(tmp_path, samples):
    gap = samples["p_aortic"].copy()
    gap[1000:1100] = np.nan
    trace = read(tmp_path, Group((Wave("Ao", gap), Wave("Pd", samples["p_distal"]))))
    assert trace.t.size == 5900
    assert trace.remarks == ("100 of 6000 samples hold no plausible number: left out.",)


def test_status_of_a_channel_is_told(tmp_path, samples):
    trace = read(tmp_path, Group(pair(samples, status="UNZEROED")))
    assert trace.remarks == ("The file calls Ao UNZEROED.",)


def test_big_endian_samples_are_the_same(tmp_path, samples):
    from pydicom.dataset import Dataset
    from pydicom.uid import ExplicitVRBigEndian

    path = tmp_path / "x_rest.dcm"
    made = waveform_file(Group(pair(samples)))
    for group in made.WaveformSequence:
        for tag in (0x5400100A, 0x54001010):
            group[tag].value = np.frombuffer(group[tag].value, "<i2").astype(">i2").tobytes()
    made.file_meta.TransferSyntaxUID = ExplicitVRBigEndian
    plain = Dataset()
    plain.file_meta = made.file_meta
    plain.update(made)
    plain.save_as(path, implicit_vr=False, little_endian=False, enforce_file_format=True)
    found = read_trace(path, AS_IT_IS).waves["P_aorta"]
    np.testing.assert_allclose(found, decoded(pair(samples)[0]), atol=1e-9)


def test_any_damage_is_refused_in_words_or_read(tmp_path, samples):
    rng = np.random.default_rng(5)
    short = {name: column[:1500] for name, column in samples.items()}
    path = tmp_path / "x_rest.dcm"
    write_waveforms(path, Group(pair(short)))
    whole = path.read_bytes()
    header = len(whole) - 2 * 2 * 1500
    faults = []
    for _ in range(150):
        content = bytearray(whole)
        for at in rng.integers(132, header, size=int(rng.integers(1, 12))):
            content[at] = rng.integers(256)
        if rng.random() < 0.3:
            content = content[: int(rng.integers(len(content)))]
        path.write_bytes(bytes(content))
        try:
            read_trace(path, AS_IT_IS)
        except CaseError as error:
            faults.append(len(error.faults))
    assert 60 < len(faults) < 150
    assert set(faults) == {1}
