"""Bad case files: every fault is named, with its file, key and cure, and all at once."""

import math
import pathlib
import pickle
import re

import pytest

from study import CaseError, read_case

GOOD = (pathlib.Path(__file__).parent / "good_case.toml").read_text()


def beat_text(count: int = 40, period: float = 0.8) -> str:
    rows = [f"{k * period / count:.4f},{90 + 20 * math.sin(k):.3f}" for k in range(count)]
    return "\n".join(["time_s,P_aorta_mmHg", *rows]) + "\n"


def write_case(folder: pathlib.Path, text: str | bytes = GOOD) -> pathlib.Path:
    folder.mkdir(exist_ok=True)
    (folder / "contours.csv").write_text("1\t5.3\t5.2\t0.0\n")
    (folder / "centerline.csv").write_text("0,0,0\n")
    (folder / "empty.csv").write_text("")
    (folder / "beat.csv").write_text(beat_text())
    file = folder / "case.toml"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return file


def refusal(file: pathlib.Path) -> CaseError:
    with pytest.raises(CaseError) as caught:
        read_case(file)
    return caught.value


BAD_EDITS = {
    # claim: (old text, new text, key named, what the message must say)
    "kPa for mmHg": (
        "P_systolic_mmHg = 110.0", "P_systolic_mmHg = 16.0",
        "condition.rest.P_systolic_mmHg", "mmHg expected; 16 looks like kPa: 120 mmHg",
    ),
    "Pa for mmHg": (
        "P_systolic_mmHg = 130.0", "P_systolic_mmHg = 12000",
        "condition.dobutamine.P_systolic_mmHg", "12000 looks like Pa: 90.01 mmHg",
    ),
    "ms for s": (
        "period_s = 0.80", "period_s = 800", "condition.rest.period_s", "looks like ms: 0.8 s",
    ),
    "heart rate for period": (
        "period_s = 0.80", "period_s = 75", "condition.rest.period_s", "looks like bpm: 0.8 s",
    ),
    "heart rate as a key": (
        "period_s = 0.80", "heart_rate = 75", "condition.rest.heart_rate",
        "write period_s = 0.8 (period = 60 s / heart rate)",
    ),
    "first letter decides between equally near keys": (
        "ffr = 0.91", "frr = 0.91", "condition.rest.frr", "the nearest valid key is ffr",
    ),
    "ml/min for l/min": (
        "per_min = 4.5", "per_min = 4500.0",
        "condition.rest.cardiac_output_l_per_min", "looks like ml/min: 4.5 l/min",
    ),
    "l for ml": (
        "volume_ml = 60.0", "volume_ml = 0.06",
        "condition.rest.stroke_volume_ml", "looks like l: 60 ml",
    ),
    "percent for ratio": (
        "ffr = 0.91", "ffr = 91", "condition.rest.ffr", "91 looks like percent: 0.91",
    ),
    "FFR above one": (
        "ffr = 0.91", "ffr = 1.2", "condition.rest.ffr", "no loss to calibrate",
    ),
    "FFR of one": ("ffr = 0.91", "ffr = 1", "condition.rest.ffr", "both excluded"),
    "FFR of zero": ("ffr = 0.91", "ffr = 0.0", "condition.rest.ffr", "both excluded"),
    "clinical unit of resistance": (
        "R0_dyn_s_per_cm5 = 5.0e3", "R0_dyn_s_per_cm5 = 3.75",
        "surrogate.R0_dyn_s_per_cm5", "looks like mmHg s/ml: 5000 dyn s/cm5",
    ),
    "SI modulus": (
        "E_dyn_per_cm2 = 2.0e7", "E_dyn_per_cm2 = 1500", "wall.E_dyn_per_cm2", "looks like kPa",
    ),
    "SI density": (
        "viscosity_poise = 0.035", "density_g_per_cm3 = 1060",
        "blood.density_g_per_cm3", "looks like kg/m3: 1.06 g/cm3",
    ),
    "SI viscosity": (
        "viscosity_poise = 0.035", "viscosity_poise = 0.0035",
        "blood.viscosity_poise", "looks like Pa s: 0.035 poise",
    ),
    "diastolic above systolic": (
        "P_diastolic_mmHg = 65", "P_diastolic_mmHg = 115",
        "condition.rest.P_diastolic_mmHg", "swap",
    ),
    "diastolic equal to systolic": (
        "P_diastolic_mmHg = 65", "P_diastolic_mmHg = 110",
        "condition.rest.P_diastolic_mmHg", "not below P_systolic_mmHg = 110",
    ),
    "negative resistance": (
        "R_1_dyn_s_per_cm5 = 4e4", "R_1_dyn_s_per_cm5 = -4e4",
        "coronary.R_1_dyn_s_per_cm5", "check the sign",
    ),
    "zero R0": (
        "R0_dyn_s_per_cm5 = 5.0e3", "R0_dyn_s_per_cm5 = 0.0", "surrogate.R0_dyn_s_per_cm5", "below",
    ),
    "negative compliance": (
        "P_venous_mmHg = 5.0", "C_a_cm5_per_dyn = -1e-7", "coronary.C_a_cm5_per_dyn", "sign",
    ),
    "Poisson ratio": ("[wall]", "[wall]\nnu = 0.6", "wall.nu", "0 to 0.5"),
    "wrong unit in key": (
        "P_systolic_mmHg = 110.0", "P_systolic_kPa = 16",
        "condition.rest.P_systolic_kPa", "write P_systolic_mmHg = 120 (1 kPa = 7.50064 mmHg)",
    ),
    "no unit in key": (
        "P_systolic_mmHg = 110.0", "P_systolic = 110",
        "condition.rest.P_systolic", "write P_systolic_mmHg = 110 if that is in mmHg",
    ),
    "unit of nothing in key": (
        "period_s = 0.80", "period_fortnight = 0.80",
        "condition.rest.period_fortnight", "write period_s, in s",
    ),
    "heart rate in key": (
        "period_s = 0.80", "HR_bpm = 75", "condition.rest.HR_bpm", "write period_s = 0.8 (period",
    ),
    "percent in key": (
        "ffr = 0.91", "ffr_percent = 91", "condition.rest.ffr_percent", "write ffr = 0.91",
    ),
    "same key in two units": (
        "period_s = 0.80", "period_s = 0.80\nperiod_ms = 800",
        "condition.rest.period_ms", "remove it: period_s = 0.8 is given as well",
    ),
    "misspelt key": (
        "P_diastolic_mmHg = 65", "P_diastollic_mmHg = 65",
        "condition.rest.P_diastollic_mmHg", "the nearest valid key is P_diastolic_mmHg",
    ),
    "capitals in key": (
        "P_diastolic_mmHg = 65", "p_diastolic_MMHG = 65",
        "condition.rest.p_diastolic_MMHG", "write P_diastolic_mmHg = 65",
    ),
    "tissue outside the wall": (
        "[wall]", "[wall]\nsupport_stiffness = 1e5",
        "wall.support_stiffness", "tissue outside the wall stands in a table of its own, [tissue]",
    ),
    "tissue with a unit": (
        "[wall]", "[wall]\nsupport_stiffness_dyn_per_cm3 = 1e5",
        "wall.support_stiffness_dyn_per_cm3", "stiffness_dyn_per_cm3 and damping_dyn_s_per_cm3",
    ),
    "table of the tissue": (
        "[coronary]", "[tissue]\nstiffness = 1e5\n[coronary]",
        "tissue.stiffness", "write stiffness_dyn_per_cm3 = 100000 if that is in dyn/cm3",
    ),
    "tissue in other units": (
        "[coronary]", "[tissue]\nstiffness_kPa_per_mm = 1\n[coronary]",
        "tissue.stiffness_kPa_per_mm", "write stiffness_dyn_per_cm3 = 1e+05 (1 kPa/mm = 100000",
    ),
    "key of the tissue in the wall": (
        "[wall]", "[wall]\nstiffness_dyn_per_cm3 = 1e5",
        "wall.stiffness_dyn_per_cm3", "move it below [tissue]",
    ),
    "key of two tables": (
        "[coronary]", "[coronary]\ndensity_g_per_cm3 = 1.0",
        "coronary.density_g_per_cm3", "move it below [blood] or [wall]",
    ),
    "shear thinning without a law": (
        "[blood]", "[blood]\nmu_0_poise = 0.5", "blood.law", 'add law = "carreau_yasuda"',
    ),
    "blood that thickens": (
        "[blood]", '[blood]\nlaw = "carreau_yasuda"\nmu_0_poise = 0.03',
        "blood.mu_0_poise", "not above mu_inf_poise = 0.0345",
    ),
    "SI damping of the wall": (
        "[wall]", "[wall]\ndamping_Pa_s = 100", "wall.damping_Pa_s", "write damping_poise = 1000",
    ),
    "penalty of another law": (
        "[wall]", '[wall]\nmaterial = "neo_hookean"\nvolumetric_penalty_dyn_per_cm2 = 1e6',
        "wall.volumetric_penalty_dyn_per_cm2", 'write material = "saint_venant_kirchhoff"',
    ),
    "fibres of another law": (
        "[wall]", '[wall]\nmaterial = "neo_hookean"\nk1_dyn_per_cm2 = 1e6\ndispersion = 0.1',
        "wall.k1_dyn_per_cm2",
        'remove k1_dyn_per_cm2 and dispersion, or write material = "holzapfel_gasser_ogden"',
    ),
    "fibres of the usual law": (
        "[wall]", "[wall]\nfibre_angle_deg = 40",
        "wall.fibre_angle_deg", "the law saint_venant_kirchhoff has no fibres",
    ),
    "fibres without stiffness": (
        "[wall]", '[wall]\nmaterial = "holzapfel_gasser_ogden"\nk2 = 2',
        "wall.k1_dyn_per_cm2", "the fibres have no stiffness",
    ),
    "fibres beyond all directions": (
        "[wall]",
        '[wall]\nmaterial = "holzapfel_gasser_ogden"\nk1_dyn_per_cm2 = 1e6\ndispersion = 0.4',
        "wall.dispersion", "from 0, aligned, to 1/3, in all directions",
    ),
    "key like no other": ("[blood]", "[blood]\nzzz = 1", "blood.zzz", "remove it"),
    "key that needs quotes": ("[blood]", '[blood]\n"a\\nb" = 1', "'a\\\\nb'", "remove it"),
    "key in the wrong table": (
        "[coronary]", "[coronary]\nC0_cm5_per_dyn = 1e-7",
        "coronary.C0_cm5_per_dyn", "move it below [surrogate]",
    ),
    "key of another kind of anatomy": (
        'kind = "ivus"', 'kind = "ivus"\nsurface = "x.stl"',
        "anatomy.surface", 'move it below [anatomy] with kind = "surface"',
    ),
    "key above all tables": (
        "[patient]", "period_s = 1\n[patient]", "period_s", "move it below [condition.NAME]",
    ),
    "misspelt table": ("[surrogate]", "[surogate]", "surogate", "[surrogate]"),
    "misspelt required table": ("[patient]", "[pateint]", "pateint", "[patient]"),
    "table like no other": ("[blood]", "[zzz]", "zzz", "use a valid table"),
    "condition without its prefix": (
        "[condition.dobutamine]", "[dobutamine]", "dobutamine", "[condition.dobutamine]",
    ),
    "condition Rest": (
        "[condition.rest]", "[condition.Rest]", "condition.Rest", "write [condition.rest]",
    ),
    "name of condition": (
        "[condition.dobutamine]", '[condition."dobutamine 20/5"]',
        "condition.'dobutamine 20/5'", "[condition.dobutamine_20_5]",
    ),
    "key outside any condition": (
        "[blood]", "[condition]\nexercise = 3\n[blood]", "condition.exercise", "[condition.rest]",
    ),
    "stress called rest": (
        'kind = "stress"', 'kind = "rest"', "condition.dobutamine.kind", "remove kind",
    ),
    "missing key": (
        "period_s = 0.45\n", "", "condition.dobutamine.period_s", "add period_s = ...",
    ),
    "missing id": ('id = "anomalous-rca-01"\n', "", "patient.id", 'add id = "..."'),
    "id that is no file name": (
        '"anomalous-rca-01"', '"../other"', "patient.id", "a name that can be a file name",
    ),
    "id that is a number": ('"anomalous-rca-01"', "7", "patient.id", "put it in quotes"),
    "number in quotes": (
        "period_s = 0.80", 'period_s = "0.80"', "condition.rest.period_s",
        "remove the quotes: period_s = 0.80",
    ),
    "word for a number": (
        "period_s = 0.80", 'period_s = "long"', "condition.rest.period_s", "give a number, in s",
    ),
    "truth value for a number": (
        "period_s = 0.80", "period_s = true", "condition.rest.period_s", "a number is expected",
    ),
    "list for a number": (
        "period_s = 0.80", "period_s = [0.8]", "condition.rest.period_s", "a number is expected",
    ),
    "date for a number": (
        "period_s = 0.80", "period_s = 2024-01-01", "condition.rest.period_s", "= 2024-01-01: a nu",
    ),
    "infinite number": (
        "period_s = 0.80", "period_s = inf", "condition.rest.period_s", "not a finite number",
    ),
    "not a number": (
        "period_s = 0.80", "period_s = nan", "condition.rest.period_s", "not a finite number",
    ),
    "integer too large for a float": (
        "period_s = 0.80", "period_s = 1" + 400 * "0",
        "condition.rest.period_s", "an integer of 1329 bits",
    ),
    "integer too large in a wrong unit": (
        "period_s = 0.80", "period_ms = 1" + 400 * "0", "condition.rest.period_ms", "in s",
    ),
    "broken number of cycles": (
        "cycles = 4", "cycles = 4.5", "solver.cycles", "round it: cycles = 4",
    ),
    "table for a number": (
        "period_s = 0.80", "period_s = { value = 1 }", "condition.rest.period_s", "a number",
    ),
    "number for a table": (
        "[blood]\nviscosity_poise = 0.035", "", "blood", "write [blood] on a line of its own",
    ),
    "number for a free text": ('"invented"', "3", "patient.source", 'write source = "..."'),
    "unknown choice": ('"coarse"', '"coarsest"', "mesh.preset", 'write "coarse"'),
    "unknown kind of anatomy": ('"ivus"', '"ct"', "anatomy.kind", '"mesh"'),
    "missing kind of anatomy": ('kind = "ivus"\n', "", "anatomy.kind", 'add kind = "..."'),
    "missing contours": (
        'contours = "contours.csv"\n', "", "anatomy.contours", "file of frame, x, y, z",
    ),
    "contours that do not exist": (
        '"contours.csv"', '"nowhere.csv"', "anatomy.contours", "no such file",
    ),
    "empty contours": ('"contours.csv"', '"empty.csv"', "anatomy.contours", "the file is empty"),
    "folder for contours": ('"contours.csv"', '"."', "anatomy.contours", "not a regular file"),
    "path too long": ('"contours.csv"', f'"{5000 * "a"}"', "anatomy.contours", "cannot be used"),
    "path with a null": ('"contours.csv"', '"a\\u0000b"', "anatomy.contours", "give the path"),
    "Windows path": ('"contours.csv"', "'data\\c.csv'", "anatomy.contours", "forward slashes"),
    "two sizes of the aorta": (
        "aorta_radius_mm = 14.0", 'aorta_radius_mm = 14.0\naorta_centerline = "centerline.csv"',
        "anatomy.aorta_radius_mm", "keep either aorta_centerline, which holds the radii",
    ),
    "aorta beside nothing": (
        'centerline = "centerline.csv"\nseptum_mm = 0.8\naorta_radius_mm = 14.0',
        'aorta_centerline = "centerline.csv"\nseptum_mm = 0.8',
        "anatomy.aorta_centerline", "it needs centerline, which is missing",
    ),
    "normal coronary without its aorta": (
        "septum_mm = 0.8", 'septum_mm = 0.8\nnormal_centerline = "centerline.csv"',
        "anatomy.normal_centerline", "add aorta_centerline = ... below [anatomy]",
    ),
    "length of no stem": (
        "septum_mm = 0.8", "septum_mm = 0.8\nnormal_length_mm = 10.0",
        "anatomy.normal_length_mm", "add normal_centerline = ... below [anatomy], or leave",
    ),
    "thickness bounds": (
        "min_mm = 0.3", "min_mm = 3", "wall.thickness_per_radius.min_mm", "not below max_mm = 2",
    ),
    "rule and factors": (
        "[solver]", "[stress.factors]\nR_1 = 0.5\n[solver]", "stress.rule", "keep either",
    ),
    "stroke volume of another output": (
        "volume_ml = 60.0", "volume_ml = 5.0",
        "condition.rest.stroke_volume_ml", "cardiac_output_l_per_min times period_s is 60 ml",
    ),
    "loss without a law": ('law = "quadratic"\n', "", "surrogate.law", 'law = "linear"'),
}  # fmt: skip


@pytest.mark.parametrize("claim", BAD_EDITS)
def test_bad_case_gives_one_clear_fault(tmp_path, claim):
    old, new, key, says = BAD_EDITS[claim]
    assert GOOD.count(old) >= 1
    text = GOOD.replace(old, new, 1)
    if claim == "number for a table":
        text = "blood = 3\n" + text
    error = refusal(write_case(tmp_path, text))
    assert len(error.faults) == 1, str(error)
    fault, message = error.faults[0], str(error)
    assert str(tmp_path / "case.toml") in message
    assert key.replace("\\\\", "\\") in message
    assert says in message
    assert fault.cure
    assert fault.cure in message
    assert len(str(fault).splitlines()) == 2


BAD_BEATS = {
    "too short": (beat_text(20, 0.4), "shorter than the period"),
    "two beats": (beat_text(80, 1.6), "cut the record to one beat"),
    "too few": (beat_text(6), "at least 8 samples"),
    "sample lost": (re.sub(r"(?m)^0\.4000.*\n", "", beat_text()), "not uniform"),
    "late start": (
        "time_s,P_aorta_mmHg\n" + "".join(f"{0.3 + 0.02 * k:.2f},90\n" for k in range(40)),
        "subtract 0.3 s",
    ),
    "unsorted": ("time_s,P_aorta_mmHg\n" + "0,90\n" * 10, "do not increase"),
    "kPa": (
        "time_s,P_aorta_mmHg\n" + "".join(f"{0.02 * k:.2f},9.5\n" for k in range(40)),
        "looks like kPa",
    ),
    "kPa within the range of mmHg": (
        "time_s,P_aorta_mmHg\n" + "".join(f"{0.02 * k:.2f},{11 + k / 10}\n" for k in range(40)),
        "the peak is far from the systolic pressure",
    ),
    "not finite": (beat_text().replace(",90.000", ",nan"), "not a row of finite numbers"),
    "decimal comma": (beat_text().replace(",90.000", ",90,000"), "decimal mark"),
    "words": (beat_text().replace(",90.000", ",high"), "not a row of finite numbers"),
    "no header": (beat_text().split("\n", 1)[1], "lacks time_s and P_aorta_mmHg"),
    "wrong unit in header": (beat_text().replace("time_s", "time_ms"), "convert column time_ms"),
    "misspelt header": (beat_text().replace("aorta_", "aotra_"), "rename column P_aotra_mmHg"),
    "column twice": (
        re.sub(r"(?m)^([^,]*),(.*)$", r"\1,\2,\2", beat_text()),
        "a column is given twice",
    ),
    "semicolons": (beat_text().replace(",", ";"), "separate the columns by commas"),
    "binary": (b"\x89PNG\r\n\x1a\n\xff\xfe", "not a UTF-8 text"),
}  # fmt: skip


def test_a_file_that_is_named_as_a_folder_is_refused(tmp_path):
    file = write_case(tmp_path)
    file.write_text(file.read_text().replace('"beat.csv"', '"beat.csv/"'))
    (tmp_path / "beat.csv").write_text(beat_text())
    assert "names a folder" in str(refusal(file))


def test_far_too_many_conditions_are_one_fault(tmp_path):
    file = write_case(tmp_path)
    more = "[condition.c{}]\nP_systolic_mmHg = 130.0\nP_diastolic_mmHg = 70.0\nperiod_s = 0.5\n"
    file.write_text(file.read_text() + "".join(more.format(k) for k in range(200)))
    (tmp_path / "beat.csv").write_text(beat_text())
    assert "more conditions than one patient has" in str(refusal(file))


@pytest.mark.parametrize("claim", BAD_BEATS)
def test_bad_beat_gives_one_clear_fault(tmp_path, claim):
    text, says = BAD_BEATS[claim]
    file = write_case(tmp_path)
    (tmp_path / "beat.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    error = refusal(file)
    assert len(error.faults) == 1, str(error)
    assert error.faults[0].file == tmp_path / "beat.csv"
    assert "condition.rest.waveform" in str(error)
    assert says in str(error)


UNREADABLE = {
    "empty": (b"", "the file is empty"),
    "blank": (b"\n \n", "the file is empty"),
    "binary": (bytes(range(256)), "not a UTF-8 text"),
    "UTF-16": (GOOD.encode("utf-16"), "save it again as UTF-8"),
    "null bytes": (b"\0\0\0\0", "not valid TOML"),
    "syntax": (b'[patient]\nid "a"\n', "line 2, column 4"),
    "key twice": (b'[patient]\nid = "a"\nid = "b"\n', "line 3"),
    "table twice": (b'[patient]\nid = "a"\n[patient]\n', "line 3"),
    "deep lists": (b"a = " + 5000 * b"[", "nested too deeply"),
    "endless number": (b"a = " + 5000 * b"1", "a great many digits"),
    "huge": (b"#" * (2**20 + 1), "too large for a case file"),
    "only comments": (b"# nothing here\n", "patient.id"),
    "conditions as a list": (
        b'[patient]\nid = "a"\n[[condition]]\nname = "rest"\n',
        "[condition.rest]",
    ),
    "huge hexadecimal in a list": (b'patient.id = [0x' + 9000 * b"f" + b"]", "a list"),
}  # fmt: skip


@pytest.mark.parametrize("claim", UNREADABLE)
def test_unreadable_file_gives_one_clear_fault(tmp_path, claim):
    content, says = UNREADABLE[claim]
    error = refusal(write_case(tmp_path, content))
    assert len(error.faults) == 1, str(error)
    assert str(tmp_path / "case.toml") in str(error)
    assert says in str(error)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nowhere.toml", "no such file"),
        (".", "a folder"),
        ("a\0b.toml", "check the path"),
        (5000 * "a", "check the path"),
        ("contours.csv/case.toml", "no such file"),
    ],
)
def test_unusable_path_gives_one_clear_fault(tmp_path, name, says):
    write_case(tmp_path)
    error = refusal(tmp_path / name)
    assert len(error.faults) == 1
    assert says in str(error)


def test_all_faults_are_reported_together(tmp_path):
    edits = {
        '"anomalous-rca-01"': '"a/b"',
        '"contours.csv"': '"nowhere.csv"',
        "E_dyn_per_cm2 = 2.0e7": "E_Pa = 1.5e6",
        "P_systolic_mmHg = 110.0": "P_systolic_mmHg = 16",
        "ffr = 0.91": "ffr = 1.2",
        "period_s = 0.45\n": "",
        "R_1_dyn_s_per_cm5": "R_4_dyn_s_per_cm5",
        'law = "quadratic"': 'law = "cubic"',
        "cycles = 4": "cycles = true",
    }
    text = GOOD
    for old, new in edits.items():
        text = text.replace(old, new, 1)
    error = refusal(write_case(tmp_path, text))
    assert {fault.key for fault in error.faults} == {
        "patient.id",
        "anatomy.contours",
        "wall.E_Pa",
        "condition.rest.P_systolic_mmHg",
        "condition.rest.ffr",
        "condition.dobutamine.period_s",
        "coronary.R_4_dyn_s_per_cm5",
        "surrogate.law",
        "solver.cycles",
    }
    assert len(error.faults) == len(edits)
    message = str(error)
    assert message.startswith("the input was refused: 9 faults")
    assert all(str(fault) in message for fault in error.faults)
    assert str(pickle.loads(pickle.dumps(error))) == message


def test_refused_case_leaves_nothing_behind(tmp_path):
    file = write_case(tmp_path, GOOD.replace("0.91", "1.2"))
    before = sorted(tmp_path.iterdir())
    refusal(file)
    assert sorted(tmp_path.iterdir()) == before
