"""Case files: values in CGS, the template, what commands need, and files damaged at random."""

import dataclasses
import math
import pathlib
import re
import tomllib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lumped.units import MMHG
from study import (
    REQUIREMENTS,
    CaseError,
    CoronaryParameters,
    Fault,
    IvusAnatomy,
    MeshAnatomy,
    SurfaceAnatomy,
    SurrogateParameters,
    SyntheticAnatomy,
    WallParameters,
    case_template,
    read_case,
    require,
)
from study.case.anatomy import KINDS
from study.case.condition import CONDITION
from study.case.parameters import STRESS_FACTORS
from study.case.schema import keys_of
from study.case.tables import PLAIN, STRESS, THICKNESS, WALL

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


def test_good_case_is_read_in_cgs(tmp_path):
    case = read_case(write_case(tmp_path))
    rest = case.conditions["rest"]
    # one product or quotient of rounded factors each: a few units in the last place
    exact = {"rel": 1e-14}
    assert case.id == "anomalous-rca-01"
    assert list(case.conditions) == ["rest", "dobutamine"]
    assert (rest.kind, case.conditions["dobutamine"].kind) == ("rest", "stress")
    assert rest.P_systolic == pytest.approx(110 * 1333.22, **exact)
    assert rest.P_diastolic == pytest.approx(65 * 1333.22, **exact)
    assert (rest.period, rest.stroke_volume, rest.ffr, rest.ffr_sd) == (0.8, 60.0, 0.91, 0.01)
    assert rest.cardiac_output == pytest.approx(75.0, **exact)
    assert case.conditions["dobutamine"].ffr is None
    assert isinstance(case.anatomy, IvusAnatomy)
    assert case.anatomy.contours == tmp_path / "contours.csv"
    assert case.anatomy.aorta_radius == pytest.approx(1.4, **exact)
    assert (case.blood.mu, case.blood.rho_f) == (0.035, 1.06)
    assert (case.wall.E, case.wall.nu, case.wall.thickness_per_radius) == (2e7, 0.49, 0.12)
    assert case.wall.thickness_min == pytest.approx(0.03, **exact)
    assert case.wall.thickness_max == pytest.approx(0.2, **exact)
    assert case.coronary == CoronaryParameters(R_1=4e4, P_venous=5.0 * MMHG)
    assert case.surrogate == SurrogateParameters(R0=5e3, K=800.0, law="quadratic")
    assert (case.stress.rule, case.stress.factors) == ("all", None)
    assert dataclasses.astuple(case.solver)[:3] == (1e-3, 4, 1000)
    assert dataclasses.astuple(case.mesh) == ("coarse", 6, 2, 1, "netgen", "cm")
    assert case.source == {"patient": "invented", "condition.rest": "cohort mean"}
    for command in REQUIREMENTS:
        require(case, command)


def test_measured_beat_is_read_without_its_repeated_end(tmp_path):
    file = write_case(tmp_path)
    open_beat = read_case(file).conditions["rest"].waveform
    (tmp_path / "beat.csv").write_text(beat_text() + "0.8000,90.0\n")
    closed_beat = read_case(file).conditions["rest"].waveform
    assert open_beat == closed_beat
    assert open_beat is not None
    assert len(open_beat.t) == len(open_beat.P_aorta) == 40
    assert open_beat.P_aorta[0] == pytest.approx(90 * MMHG, rel=1e-14)  # one product


def test_beat_with_clock_times_rounded_to_milliseconds_is_uniform(tmp_path):
    # 240 Hz: the step is 4.17 ms, so that rounding moves a sample by at most 0.12 steps
    rows = [f"{round(k / 240, 3)},{90 + k % 7}" for k in range(192)]
    file = write_case(tmp_path)
    (tmp_path / "beat.csv").write_text("\n".join(["time_s,P_aorta_mmHg", *rows]))
    beat = read_case(file).conditions["rest"].waveform
    assert beat is not None
    assert len(beat.t) == 192


@pytest.mark.parametrize(
    ("table", "kind"),
    [
        ('kind = "synthetic"\nside = "left"\ntake_off_angle_deg = 20', SyntheticAnatomy),
        ('kind = "surface"\nsurface = "contours.csv"\nunit = "mm"', SurfaceAnatomy),
        ('kind = "mesh"\npath = "contours.csv"\nunit = "cm"', MeshAnatomy),
    ],
)
def test_other_anatomies_are_accepted(tmp_path, table, kind):
    text = f'[patient]\nid = "a"\n[anatomy]\n{table}\n'
    assert isinstance(read_case(write_case(tmp_path, text)).anatomy, kind)


def test_take_off_angle_is_in_radians(tmp_path):
    text = '[patient]\nid = "a"\n[anatomy]\nkind = "synthetic"\ntake_off_angle_deg = 30\n'
    anatomy = read_case(write_case(tmp_path, text)).anatomy
    assert isinstance(anatomy, SyntheticAnatomy)
    assert anatomy.given == {"take_off_angle": pytest.approx(math.pi / 6, rel=1e-14)}  # one product


def test_own_stress_factors_default_to_one(tmp_path):
    text = '[patient]\nid = "a"\n[stress.factors]\nR_2 = 0.5\nC_im = 2\n'
    stress = read_case(write_case(tmp_path, text)).stress
    assert stress.rule == "factors"
    assert stress.factors == {"R_1": 1.0, "R_2": 0.5, "R_3": 1.0, "C_a": 1.0, "C_im": 2.0}


def test_template_is_a_valid_case(tmp_path):
    case = read_case(write_case(tmp_path, case_template()))
    # its anatomy is commented out
    for command in set(REQUIREMENTS) - {"mesh", "simulate", "study", "calibrate-wall"}:
        require(case, command)
    assert case.wall == WallParameters()
    assert case.coronary == CoronaryParameters()


def test_template_shows_every_default_and_every_optional_key(tmp_path):
    plain = read_case(write_case(tmp_path, case_template()))
    full_text = re.sub(r"^#(?=\w+ = |\[)", "", case_template(), flags=re.MULTILINE)
    full_text = full_text.replace("rest_beat.csv", "beat.csv")
    full_text = re.sub(r"^aorta_radius_mm = .*\n", "", full_text, flags=re.MULTILINE)
    file = write_case(tmp_path, full_text)  # the radius stands in place of the aorta's line
    lines = ("aorta_centerline.csv", "left_centerline.csv")
    for name in ("frames.csv", "reference.csv", "eem_contours.csv", *lines):
        (tmp_path / name).write_text("x")
    full = read_case(file)
    assert (full.blood, full.coronary) == (plain.blood, plain.coronary)
    assert dataclasses.replace(full.wall, E_coronary=None, E_septum=None) == plain.wall
    assert None not in (full.wall.E_coronary, full.wall.E_septum)
    assert full.stress == plain.stress
    assert full.surrogate == dataclasses.replace(plain.surrogate, K=1e3)
    only_stress = {"drug": "other", "flow_reserve": 1.0, "flow_reserve_sd": 0.1}
    rest = dataclasses.replace(full.conditions["rest"], **only_stress)
    assert None not in dataclasses.astuple(rest)
    assert full.conditions["dobutamine"].flow_reserve is not None
    assert None not in dataclasses.astuple(full.body)
    assert full.uncertainty.bed_factor is not None
    assert None not in dataclasses.astuple(full.solver)
    require(full, "mesh")
    assert full.anatomy is not None
    assert isinstance(full.anatomy, IvusAnatomy)
    assert None not in vars(dataclasses.replace(full.anatomy, aorta_radius=1.4)).values()
    assert all(None not in vars(state).values() for state in full.anatomy.states.values())
    assert dataclasses.replace(full.mesh, elements_across=None) == plain.mesh
    assert full.mesh.elements_across is not None


def test_template_names_every_key():
    text = case_template()
    full = tomllib.loads(re.sub(r"^#(?=\w+ = |\[)", "", text, flags=re.MULTILINE))
    conditions = {key for entry in full["condition"].values() for key in entry}
    plain = {name: keys_of(model) for name, model in PLAIN.items()}
    for name, keys in {**plain, "wall": WALL, "stress": STRESS}.items():
        assert {key.key for key in keys} <= set(full[name]), name
    assert {key.key for key in CONDITION} <= conditions
    others = [key for kind in ("ivus", "surface", "mesh") for key in KINDS[kind]]
    for key in (*others, *THICKNESS, *STRESS_FACTORS):
        assert re.search(rf"\b{key.key}\b", text), key.key


def test_text_with_byte_order_mark_and_windows_line_ends_is_read(tmp_path):
    content = b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode()
    assert read_case(write_case(tmp_path, content)).id == "anomalous-rca-01"


BARE = '[patient]\nid = "a"\n'
REST = BARE + "[condition.rest]\nP_systolic_mmHg = 110\nP_diastolic_mmHg = 65\nperiod_s = 0.8\n"


@pytest.mark.parametrize(
    ("text", "command", "missing"),
    [
        (BARE, "run", ["condition.rest", "condition.rest.ffr", "surrogate.R0_dyn_s_per_cm5"]),
        (BARE, "sweep", ["condition.rest", "surrogate.R0_dyn_s_per_cm5"]),
        (REST, "calibrate", ["condition.rest.ffr", "surrogate.R0_dyn_s_per_cm5"]),
        (REST + "[surrogate]\nR0_dyn_s_per_cm5 = 5e3", "run", ["condition.rest.ffr"]),
        (REST + "[surrogate]\nR0_dyn_s_per_cm5 = 5e3", "sweep", []),
        (REST + 'ffr = 0.9\n[anatomy]\nkind = "ivus"\ncontours = "contours.csv"', "run", []),
        (
            REST + '[surrogate]\nR0_dyn_s_per_cm5 = 5e3\nlaw = "quadratic"',
            "sweep",
            ["surrogate.K_dyn_s2_per_cm8"],
        ),
    ],
)
def test_command_names_all_that_it_misses(tmp_path, text, command, missing):
    case = read_case(write_case(tmp_path, text))
    if not missing:
        require(case, command)
        return
    with pytest.raises(CaseError) as caught:
        require(case, command)
    assert [fault.key for fault in caught.value.faults] == missing
    assert all(fault.cure in str(caught.value) for fault in caught.value.faults)


def test_requirements_can_be_extended(tmp_path, monkeypatch):
    case = read_case(write_case(tmp_path, BARE))
    with pytest.raises(ValueError, match="try one of run, calibrate, sweep, mesh"):
        require(case, "fly")

    def anatomy(case):
        return Fault(case.path, "anatomy", None, "missing", "", "add it")

    monkeypatch.setitem(REQUIREMENTS, "fly", (anatomy,))
    with pytest.raises(CaseError, match="anatomy: missing"):
        require(case, "fly")


def reads_or_refuses(file: pathlib.Path) -> None:
    """Any other exception fails the test; a refusal must print."""
    refused: CaseError | None = None
    try:
        read_case(file)
    except CaseError as error:
        refused = error
    if refused is not None:
        assert refused.faults
        assert "try: " in str(refused)


@st.composite
def damaged(draw: st.DrawFn, text: str) -> bytes:
    lines = text.splitlines(keepends=True)
    for _ in range(draw(st.integers(0, 3))):
        place = draw(st.integers(0, len(lines) - 1))
        if draw(st.booleans()):
            lines.insert(draw(st.integers(0, len(lines))), lines[place])
        elif len(lines) > 1:
            del lines[place]
    content = bytearray("".join(lines).encode())
    for _ in range(draw(st.integers(0, 3))):
        content[draw(st.integers(0, len(content) - 1))] ^= draw(st.integers(1, 255))
    return bytes(content)


@pytest.fixture(scope="module")
def shelf(tmp_path_factory) -> pathlib.Path:
    return tmp_path_factory.mktemp("damaged")


# fixed seeds (derandomize): the same damage in every run; no deadline, the machine may be busy
thorough = settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)


@thorough
@given(content=damaged(GOOD))
def test_damaged_case_is_read_or_refused(shelf, content):
    reads_or_refuses(write_case(shelf, content))


@thorough
@given(content=damaged(beat_text()))
def test_damaged_beat_is_read_or_refused(shelf, content):
    file = write_case(shelf)
    (shelf / "beat.csv").write_bytes(content)
    reads_or_refuses(file)


STRANGE = """\
true -0.0 1e-323 -1e308 1e400 nan [] [[1],{a=1}] {} "" {period_s=1} 1979-05-27T07:32:00Z 07:32:00
"\\u0000" "\\n" '..' "1e5" {""={""=1}} ["a",1e5] -7 [[[[[[1]]]]]] {a=[{b=1}]}
"""
VALUES = st.sampled_from([*STRANGE.split(), "0x" + 5000 * "f", "1" + 320 * "0"])
KEYS = [line.split(" = ")[0] for line in GOOD.splitlines() if " = " in line]
PLACES = st.sampled_from(
    [i for i, line in enumerate(GOOD.splitlines()) if " = " in line or line.startswith("[")]
)


@thorough
@given(
    place=PLACES, value=VALUES, key=st.sampled_from([None, "condition", "x", "period_ms", *KEYS])
)
def test_strange_value_is_read_or_refused(shelf, place, value, key):
    lines = GOOD.splitlines()
    line = lines[place]
    if line.startswith("["):
        name = key or line.strip("[]")
    else:
        name = key or line.split(" = ")[0]
    lines[place] = f"{name} = {value}"
    reads_or_refuses(write_case(shelf, "\n".join(lines)))


@pytest.mark.parametrize(
    ("element", "asked", "layers"),
    [
        ("bending", "", 1),
        ("bending", "wedge_layers = 2\n", 2),
        ("quadratic", "", 1),
        ("linear", "", 0),
    ],
)
def test_wall_that_bends_stands_in_columns(element, asked, layers, tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(
        '[patient]\nid = "a"\n[anatomy]\nkind = "synthetic"\n'
        f'[wall]\nelement = "{element}"\n[mesh]\n{asked}'
    )
    assert read_case(file).mesh.wedge_layers == layers
