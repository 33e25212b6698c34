import csv
import pathlib

import numpy as np
import pytest

from jaxfsi import read_ivus_contours
from study import demo_case_path

BUNDLED = demo_case_path().parent


def rows(n_frames: int = 3, n_points: int = 12) -> list[list[str]]:
    t = 2.0 * np.pi * np.arange(n_points) / n_points
    return [
        [str(10 * k), f"{(2 + k) * np.cos(a):.6f}", f"{np.sin(a):.6f}", f"{1.5 * k:g}"]
        for k in range(n_frames)
        for a in t
    ]


def write(path: pathlib.Path, table: list[list[str]], *, start: str = "") -> pathlib.Path:
    text = start + "\n".join("\t".join(row) for row in table) + "\n"
    path.write_text(text, encoding="utf-8")
    return path


def test_frames_run_from_the_ostium_downstream_in_cm(tmp_path):
    lumen = read_ivus_contours(write(tmp_path / "c.csv", rows()))
    # Written with six decimals of a millimetre.
    np.testing.assert_allclose(lumen.s, [0.0, 0.15, 0.30], atol=1e-12)
    np.testing.assert_allclose(lumen.calipers.major, [0.8, 0.6, 0.4], rtol=1e-5)


def test_columns_may_be_named_and_positions_count_from_the_ostium(tmp_path):
    plain = read_ivus_contours(write(tmp_path / "a.csv", rows()))
    named = [["Frame", "note", "Position [mm]", "x [mm]", "y"]]
    named += [[k, "-", f"{3.0 - float(z):g}", x, y] for k, x, y, z in rows()]
    other = read_ivus_contours(write(tmp_path / "b.csv", named))
    np.testing.assert_allclose(other.contours, plain.contours)
    np.testing.assert_allclose(other.s, plain.s, atol=1e-12)
    backwards = [named[0], *sorted(named[1:], key=lambda row: float(row[2]))]  # the ostium first
    other = read_ivus_contours(write(tmp_path / "c.csv", backwards))
    np.testing.assert_allclose(other.contours, plain.contours)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (["frame", "x", "y", "height"], "the columns are frame, x, y, height"),
        (["frame", "x [cm]", "y [cm]", "z [cm]"], "units cm, not mm"),
    ],
)
def test_named_columns_that_cannot_be_used_are_told(tmp_path, header, said):
    with pytest.raises(ValueError, match=said):
        read_ivus_contours(write(tmp_path / "c.csv", [header, *rows()]))


def test_byte_order_mark_closing_point_and_sense_of_rotation_do_not_matter(tmp_path):
    plain = read_ivus_contours(write(tmp_path / "a.csv", rows()))
    closed = []
    for k in range(3):
        frame = rows()[12 * k : 12 * (k + 1)]
        frame = frame[::-1] if k == 1 else frame
        closed += [*frame, frame[0]]
    other = read_ivus_contours(write(tmp_path / "b.csv", closed, start="\ufeff"))
    assert other.contours.shape == plain.contours.shape
    np.testing.assert_allclose(other.area, plain.area, rtol=1e-14)


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", "."), (";", ",")])
def test_contours_and_tables_may_be_as_a_spreadsheet_writes_them(tmp_path, separator, decimal):
    table = "frame,position,note\n0,0.5,a\n10,1.5,b\n20,2.5,\n"
    (tmp_path / "t.csv").write_text(table)
    plain = read_ivus_contours(write(tmp_path / "a.csv", rows()), frame_table=tmp_path / "t.csv")
    lines = [separator.join(v.replace(".", decimal) for v in row) for row in rows()]
    (tmp_path / "b.csv").write_text("\n".join(lines) + "\n")
    if separator == ";":
        written = table.replace(",", ";").replace(".", decimal)
        (tmp_path / "t.csv").write_text(written)
    other = read_ivus_contours(tmp_path / "b.csv", frame_table=tmp_path / "t.csv")
    np.testing.assert_array_equal(other.contours, plain.contours)
    np.testing.assert_array_equal(other.s, plain.s)


def test_frame_table_sorts_frames(tmp_path):
    path = write(tmp_path / "c.csv", rows())
    table = tmp_path / "t.csv"
    table.write_text("frame,position,phase\n20,0.0,D\n0,1.2,D\n10,2.0,D\n", encoding="utf-8")
    lumen = read_ivus_contours(path, frame_table=table)
    np.testing.assert_allclose(lumen.s, [0.0, 0.12, 0.20], atol=1e-12)
    np.testing.assert_allclose(lumen.calipers.major, [0.8, 0.4, 0.6], rtol=1e-5)


def _replace(table, line, column, value):
    table[line - 1][column] = value
    return table


FAULTS = {
    "empty": ([], ["holds no points"]),
    "truncated_line": (
        [*rows()[:35], ["20", "1.0"]],
        ["line 36", "2 values"],
    ),
    "truncated_frame": (rows()[:-3], ["line 25", "frame 20 has 9 points", "12"]),
    "nan": (_replace(rows(), 7, 1, "nan"), ["line 7", "'nan'"]),
    "infinite": (_replace(rows(), 7, 2, "-inf"), ["line 7", "'-inf'"]),
    "not_a_number": (_replace(rows(), 9, 2, "1,5"), ["line 9", "'1,5'"]),
    "fractional_frame": (_replace(rows(), 2, 0, "0.5"), ["line 2", "'0.5'"]),
    "unequal_points": (rows()[1:], ["frame 0 has 11 points", "12"]),
    "unordered_z": (
        [[f, x, y, "9"] if f == "0" else [f, x, y, z] for f, x, y, z in rows()],
        ["line 13", "z = 1.5", "z = 9"],
    ),
    "tilted_frame": (_replace(rows(), 5, 3, "0.2"), ["line 5", "z = 0.2"]),
    "frame_twice": (rows() + rows()[:12], ["line 37", "frame 0 starts a second time"]),
    "two_frames": (rows(2), ["2 frames", "3"]),
    "few_points": (rows(3, 5), ["5 points a frame"]),
    "metres": (
        [[f, f"{float(x) / 1000}", f"{float(y) / 1000}", z] for f, x, y, z in rows()],
        ["line 1", "mm wide", "in mm"],
    ),
    "centimetres": (
        [[f, f"{float(x) / 10}", f"{float(y) / 10}", z] for f, x, y, z in rows()],
        ["the widest of all frames measures 0.8 mm", "in mm"],
    ),
    "flat": ([[f, x, "0.0", z] for f, x, _, z in rows()], ["line 1", "encloses no area"]),
}


@pytest.mark.parametrize("name", list(FAULTS))
def test_faulty_file_is_refused_with_file_line_and_value(tmp_path, name):
    table, said = FAULTS[name]
    path = write(tmp_path / "faulty.csv", table)
    with pytest.raises(ValueError, match=r"faulty\.csv") as caught:
        read_ivus_contours(path)
    for words in said:
        assert words in str(caught.value)


def test_all_faults_are_reported_together(tmp_path):
    table = _replace(_replace(rows(), 7, 1, "nan"), 20, 2, "?")
    with pytest.raises(ValueError, match=r"line 7.*line 20"):
        read_ivus_contours(write(tmp_path / "c.csv", table))


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"absent\.csv: cannot be opened"):
        read_ivus_contours(tmp_path / "absent.csv")
    binary = tmp_path / "binary.csv"
    binary.write_bytes(bytes(range(256)))
    with pytest.raises(ValueError, match="is not a UTF-8 text"):
        read_ivus_contours(binary)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frame,area\n0,1\n", "no columns frame and position"),
        ("frame,position\n0,1\n10,2\n", "frame 20 is missing"),
        ("frame,position\n0,1\n10,?\n20,3\n", "line 3"),
        ("frame,position\n0,1\n10,1\n20,3\n", "share one position"),
        ("frame,position\n0,1\n10.7,2\n20,3\n", r"line 3: frame number '10\.7' is not a whole"),
        ("frame,position\n0,1\n10,2\n20,3\n10,4\n", "line 5: frame 10 .* a second time"),
    ],
)
def test_faulty_frame_table_is_refused(tmp_path, text, said):
    path = write(tmp_path / "c.csv", rows())
    table = tmp_path / "t.csv"
    table.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=said):
        read_ivus_contours(path, frame_table=table)


def _table(path: pathlib.Path) -> dict[int, dict[str, str]]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        return {int(row["frame"]): row for row in csv.DictReader(file)}


def _compare_with_table(contours: pathlib.Path, table_path: pathlib.Path) -> None:
    lumen = read_ivus_contours(contours)
    numbers = np.loadtxt(contours, usecols=0, encoding="utf-8-sig").astype(int)
    from_ostium = list(dict.fromkeys(numbers.tolist()))[::-1]
    table = _table(table_path)
    columns = {
        "lumen_area": lumen.area / 0.1**2,
        "lumen_circumf": lumen.perimeter / 0.1,
        "longest_distance": lumen.calipers.major / 0.1,
    }
    for name, values in columns.items():
        expected = [float(table[number][name]) for number in from_ostium]
        # The table is rounded to 0.01 (mm2, mm); 0.002 more for its own spline between points.
        np.testing.assert_allclose(values, expected, rtol=0.0, atol=0.007, err_msg=name)


def test_bundled_patient_matches_its_published_table():
    _compare_with_table(BUNDLED / "rest_diastole_contours.csv", BUNDLED / "rest_frames.csv")


@pytest.mark.parametrize("state", ["rest", "stress"])
@pytest.mark.parametrize("phase", ["diastolic", "systolic"])
def test_every_state_of_the_patient_matches_its_published_table(shared_data, state, phase):
    folder = shared_data / "ivus_aaoca" / f"ivus_{state}"
    _compare_with_table(folder / f"{phase}_contours.csv", folder / "combined_sorted_manual.csv")


def test_sorted_frames_make_a_smoother_vessel():
    path = BUNDLED / "rest_diastole_contours.csv"
    by_z = read_ivus_contours(path).area
    by_eye = read_ivus_contours(path, frame_table=BUNDLED / "rest_frames.csv").area
    # Total variation of the area: jumps of the catheter show as excursions back and forth.
    assert np.sum(np.abs(np.diff(by_eye))) < 0.6 * np.sum(np.abs(np.diff(by_z)))
