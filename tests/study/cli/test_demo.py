import tomllib

from study import demo_case_path


def test_bundled_case_names_files_that_exist_and_stay_small():
    path = demo_case_path()
    case = tomllib.loads(path.read_text(encoding="utf-8"))
    assert case["anatomy"]["kind"] == "ivus"
    for key in ("contours", "centerline", "aorta_centerline", "normal_centerline"):
        assert (path.parent / case["anatomy"][key]).is_file()
    assert (path.parent / "LICENSE.MIT").is_file()
    # four states of half a megabyte
    assert sum(file.stat().st_size for file in path.parent.iterdir()) < 3_000_000


def test_bundled_case_is_consistent():
    case = tomllib.loads(demo_case_path().read_text(encoding="utf-8"))
    assert set(case["condition"]) == {"rest", "dobutamine", "adenosine"}
    for condition in case["condition"].values():
        assert condition["P_systolic_mmHg"] > condition["P_diastolic_mmHg"] > 0.0
    rest = case["condition"]["rest"]
    stroke_volume = rest["cardiac_output_l_per_min"] * 1000.0 / 60.0 * rest["period_s"]
    # The stroke volume is written to two digits.
    assert abs(stroke_volume / rest["stroke_volume_ml"] - 1.0) < 0.01
