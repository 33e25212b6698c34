import numpy as np
import pytest

from benchmarks.blind.clocked import Clock, recording
from benchmarks.blind.truth import aortic
from diagnosis import resolution
from study.case import beat_folding
from study.case.beat_folding import Unfoldable, fold, warped
from study.case.faults import Fault
from study.case.onsets import RISE, find_upstrokes, rise_of
from study.case.record_beats import FEWEST_SAMPLES, read_beats

PERIOD = 0.67644
N = 128
WAVE = np.asarray(aortic(np.arange(N) / N, np.array([112.0]), np.array([66.0])))
DISTAL = 0.9 * np.roll(WAVE, 3)
NOTCH = 9.0 * np.exp(-0.5 * ((np.arange(N) / N - 0.42) / 0.02) ** 2)


def recorded(clock, *, seed=0, sd=0.5, period=PERIOD, wave=WAVE):
    rng = np.random.default_rng(seed)
    return recording(rng, {"P_aorta": wave, "P_distal": DISTAL}, period, sd, clock)


def error(beats, wave=WAVE):
    """Difference of the mean beat from the true one, of harmonics that both hold [mmHg]."""
    n = beats.shape[1]
    true = np.fft.irfft(np.fft.rfft(wave)[: n // 2 + 1] * n / N, n)
    return beats.mean(axis=0) - true


def write(path, t, traces):
    rows = [f"{a:.5f},{b:.4f},{c:.4f}" for a, b, c in zip(t, *traces.values(), strict=True)]
    path.write_text("\n".join(["time_s,P_aorta_mmHg,P_distal_mmHg", *rows]) + "\n")
    return path


def read(path, period=PERIOD):
    faults: list[Fault] = []
    return read_beats(path, period, 112.0, "condition 1.file", faults), faults


@pytest.mark.parametrize("jitter", [0.0, 0.01])
def test_a_file_of_a_clock_is_folded_by_time(tmp_path, jitter):
    t, traces = recorded(Clock(100.0, 8, jitter), sd=0.2)
    found, faults = read(write(tmp_path / "rest.csv", t, traces))
    assert not faults
    assert found.period == pytest.approx(PERIOD, rel=2e-3)
    assert found.beats["P_aorta"].shape[0] == 8
    # 0.2 mmHg a sample, eight beats, and a start that the first upstroke tells to 0.3 % of a beat
    for name, wave in (("P_aorta", WAVE), ("P_distal", DISTAL)):
        assert np.std(error(found.beats[name], wave)) < 0.6


def test_equal_beats_that_sampling_divides_are_cut_by_index(tmp_path):
    t, traces = recorded(Clock(None, 5, 0.0))
    found, faults = read(write(tmp_path / "rest.csv", t, traces))
    assert not faults
    assert found.folding is None
    assert found.period == PERIOD
    given = np.round(traces["P_aorta"], 4).reshape(5, 64)
    assert np.array_equal(found.beats["P_aorta"], given)


@pytest.mark.parametrize("seed", [7, 11, 16])
def test_noise_that_moves_upstrokes_leaves_equal_beats_equal(tmp_path, seed):
    """Noise with a memory moves a found upstroke by more than white noise would."""
    clock = Clock(256.0 / PERIOD, 6, 0.0, memory=0.02)
    t, traces = recorded(clock, seed=seed)
    traces = {name: wave[: 5 * 256] for name, wave in traces.items()}
    found, faults = read(write(tmp_path / "rest.csv", t[: 5 * 256], traces))
    assert not faults
    assert found.folding is None


def test_unequal_beats_with_a_whole_number_of_samples_in_all_are_not_cut_by_index(tmp_path):
    t, traces = recorded(Clock(64.0 / PERIOD, 8, 0.04), seed=3, sd=0.2)
    found, faults = read(write(tmp_path / "rest.csv", t[: 8 * 64], {
        name: wave[: 8 * 64] for name, wave in traces.items()
    }))  # fmt: skip
    assert not faults
    assert found.folding is not None
    assert np.std(error(found.beats["P_aorta"])) < 0.6


@pytest.mark.parametrize("stretch", ["stretched", "diastole"])
def test_beats_of_unequal_length_are_laid_over_each_other(stretch):
    t, traces = recorded(Clock(100.0, 20, 0.04, stretch, anywhere=True), sd=0.2, seed=5)
    found = fold(t, traces, PERIOD, 16)
    late = rise_of(found.beats["P_aorta"].mean(axis=0)) - RISE
    assert abs(late) < 0.005
    assert np.std(error(found.beats["P_aorta"])) < 0.6
    # no more scatter than the noise and the errors of single upstrokes leave
    assert found.beats["P_aorta"].std(axis=0).mean() < 0.8


@pytest.mark.parametrize("rate", [30.0 / 0.3, 16.6 / 0.3])
def test_a_fast_heart_with_a_notch_gives_one_upstroke_a_beat(rate):
    t, traces = recorded(Clock(rate, 30, 0.03), period=0.3, wave=WAVE + NOTCH, sd=1.0)
    found = find_upstrokes(t, traces["P_aorta"], 0.3)
    assert found.at.size in (29, 30)
    assert np.diff(found.at).max() < 0.36
    assert np.diff(found.at).min() > 0.24


def test_sixteen_samples_a_beat_are_enough_and_fewer_are_refused(tmp_path):
    assert FEWEST_SAMPLES == 16
    for rate in (16.6, 16.0):
        t, traces = recorded(Clock(rate / PERIOD, 6, 0.0), sd=0.1)
        found, faults = read(write(tmp_path / "rest.csv", t, traces))
        assert not faults
        assert found.beats["P_aorta"].shape[0] >= 5
    t, traces = recorded(Clock(13.0 / PERIOD, 6, 0.0), sd=0.1)
    _, faults = read(write(tmp_path / "rest.csv", t, traces))
    assert any("too few samples a beat" in fault.problem for fault in faults)


def test_single_lost_samples_are_taken_and_gaps_are_refused():
    t, traces = recorded(Clock(100.0, 8, 0.02), sd=0.2, seed=2)
    lost = np.ones(t.size, bool)
    lost[[40, 150, 301]] = False
    found = fold(t[lost], {n: w[lost] for n, w in traces.items()}, PERIOD, 16)
    assert found.beats["P_aorta"].shape[0] == 8
    assert np.std(error(found.beats["P_aorta"])) < 0.6
    kept = np.ones(t.size, bool)
    for k in range(8):
        kept[30 + 68 * k : 36 + 68 * k] = False
    with pytest.raises(Unfoldable, match="leave gaps"):
        fold(t[kept], {n: w[kept] for n, w in traces.items()}, PERIOD, 16)


def test_no_harmonic_is_fitted_that_the_diagnosis_leaves_out():
    assert beat_folding.HARMONICS == resolution.HARMONICS


def test_phases_are_those_of_the_mean_beat():
    since = np.linspace(0.0, 0.8, 9)[:-1]
    # the mean beat is left as it is, whatever the share
    assert np.allclose(warped(since, 0.8, 0.8, 0.3), since / 0.8)
    # an even stretch is a straight line
    assert np.allclose(warped(since, 0.9, 0.8, 1.0), since / 0.9)
    # systole keeps its length
    assert np.allclose(warped(np.array([0.2]), 0.9, 0.8, 0.0), 0.25)


def test_times_that_do_not_increase_and_another_period_are_refused(tmp_path):
    t, traces = recorded(Clock(100.0, 8, 0.0), sd=0.2)
    _, faults = read(write(tmp_path / "a.csv", np.where(t == t[9], t[8], t), traces))
    assert any("do not increase" in fault.problem for fault in faults)
    with pytest.raises(Unfoldable, match="another length than period_s"):
        fold(t, traces, 0.48, 16)


@pytest.mark.parametrize("rate", [61.0, 97.3, 131.7, 299.6])
@pytest.mark.parametrize("period", [0.33, 0.627, 0.91])
def test_two_beats_from_ejection_on_are_taken_whatever_the_rate(rate, period):
    noise = np.random.default_rng(round(rate)).standard_normal
    t = np.arange(int(2.0 * period * rate)) / rate
    phases = np.arange(WAVE.size + 1) / WAVE.size
    P = np.interp(t % period / period, phases, np.append(WAVE, WAVE[0]))
    traces = {"P_aorta": P + 0.5 * noise(t.size), "P_distal": P - 10.0}
    found = fold(t, traces, period, FEWEST_SAMPLES)
    assert found.period == pytest.approx(period, rel=0.01)
    beat = found.beats["P_aorta"].mean(axis=0)
    true = np.interp(np.arange(beat.size) / beat.size, phases, np.append(WAVE, WAVE[0]))
    assert np.std(beat - true) < 2.5  # a start that is wrong by a hundredth of a beat is 1.5 mmHg
