"""What noise leaves of a held-out trace, in a record whose error is known."""

import numpy as np
import pytest

from benchmarks.foreign.noise_floor import noise_floor, share_closed

PERIOD, N = 0.5, 100


def _record(folder, error, beats):
    """A record with a held-out condition of some beats and a given error of its distal trace."""
    t = np.linspace(0.0, beats * PERIOD, beats * N, endpoint=False)
    true = 80.0 + 10.0 * np.sin(2.0 * np.pi * t / PERIOD)
    place = folder / "records" / "0000"
    place.mkdir(parents=True)
    rows = [f"{at},{p},{p + e}" for at, p, e in zip(t, true, error, strict=True)]
    (place / "stress.csv").write_text("\n".join(["time_s,P_aorta_mmHg,P_distal_mmHg", *rows]))
    (place / "record.toml").write_text(
        "[condition.rest]\nheld_out = false\nwaveform = 'rest.csv'\n"
        f"[condition.stress]\nheld_out = true\nwaveform = 'stress.csv'\nperiod_s = {PERIOD}\n"
    )
    (folder / "truth").mkdir()
    truth = {"stress/t": t, "stress/with/P_distal": true}
    np.savez(folder / "truth" / "0000.npz", **truth)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("beats", [1, 4])
def test_floor_has_the_error_of_all_beats_and_the_mean_of_the_noise(beats, tmp_path):
    alternating = np.tile([1.0, -1.0], beats * N // 2)
    _record(tmp_path, 0.5 + 0.4 * alternating, beats)
    assert noise_floor(tmp_path, "0000") == pytest.approx(np.hypot(0.5, 0.4 / np.sqrt(beats)))


def test_no_floor_without_the_noise_free_traces(tmp_path):
    assert noise_floor(tmp_path, "0000") is None


def test_share_is_one_where_noise_alone_is_left():
    row = {"held_out_rms_mmHg": [3.0, 0.6]}
    assert share_closed(row, 0.6) == pytest.approx(1.0)
    assert share_closed({"held_out_rms_mmHg": [3.0, 1.8]}, 0.6) == pytest.approx(0.5)
    assert share_closed({"held_out_rms_mmHg": [0.7, 0.6]}, 0.6) is None  # no gap to close
    assert share_closed({}, 0.6) is None
