"""Foreign records: what the project's reader takes, truths, and the circuits behind them."""

import importlib
import json
import sys

import numpy as np
import pytest

import lumped
from benchmarks.foreign import EFFECTS, GENERATORS, OUTSIDE, other_forms, real_clock, zerod
from benchmarks.foreign.__main__ import main
from benchmarks.foreign.catalogue import DRAWERS
from benchmarks.foreign.circuit import Physics
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.members import ForeignMember, own_solver
from benchmarks.foreign.patient import draw_patient
from benchmarks.foreign.schedule import truth_of
from benchmarks.foreign.score import joined, ranked_first
from benchmarks.foreign.visibility import Nuisances, visibility
from benchmarks.foreign.waves import regular_plan
from benchmarks.foreign.zerod_forms import DRAWERS as BLOCKS
from study.case.record import read_record

try:
    import svzerod  # noqa: F401

    _ABSENT = False
except ImportError:
    _ABSENT = True
needs_svzerod = pytest.mark.skipif(
    _ABSENT, reason="svzerod (extra 'benchmark') is not installed: the generator zerod runs it"
)
ALL = [pytest.param(g, marks=needs_svzerod if g == "zerod" else ()) for g in GENERATORS]
SAME_MMHG = 0.05
"""What integrators and the grid of the sensors leave in a trace that an effect does not touch."""


def module_of(generator):
    return importlib.import_module(f"benchmarks.foreign.{generator}")


@pytest.mark.parametrize("generator", ALL)
def test_reader_takes_the_records(generator, tmp_path):
    for number in range(3):
        record = module_of(generator).draw(11, number)
        record.write(tmp_path / str(number))
        read, remarks = read_record(tmp_path / str(number))
        assert remarks == ()
        assert [c.name for c in read.conditions if c.held_out] == ["dobutamine_high"]
        assert {"P_aorta", "P_distal"} == set(read.conditions[0].beats)


@pytest.mark.parametrize("generator", ALL)
def test_a_seed_gives_the_same_record_again(generator):
    module = module_of(generator)
    first, again, other = module.draw(5, 2), module.draw(5, 2), module.draw(6, 2)
    assert first.files == again.files
    assert first.label == again.label
    assert first.files != other.files


def test_truths_come_in_turn_and_in_their_shares():
    truths = [truth_of(3, number, OUTSIDE) for number in range(200)]
    outside = [t for t in truths if t.startswith("outside:")]
    assert truths.count("none") == 30
    assert len(outside) == 40
    counts = [truths.count(name) for name in EFFECTS]
    assert sum(counts) == 130
    assert max(counts) - min(counts) <= 1
    assert len(set(outside)) == len(OUTSIDE) >= 8
    assert set(EFFECTS) <= set(DRAWERS)
    assert set(EFFECTS) <= set(BLOCKS)


def lumped_beat(patient, c):
    """Distal pressure [mmHg] and flow [mL/s] of the project's surrogate at 1600 phases."""
    bed = lumped.nominal_coronary(C_a=patient.C_a / lumped.MMHG, C_im=patient.C_im / lumped.MMHG)
    surrogate = lumped.Surrogate(
        R0=patient.R0 * lumped.MMHG, alpha=patient.alpha, coronary=bed, C0=patient.C0 / lumped.MMHG
    )
    network = surrogate.network(
        lumped.condition_from_clinic(c.P_systolic, c.P_diastolic, c.period),
        rule=lumped.stress_rule("printed") if c.stressed else None,
    )
    beat = lumped.solve_periodic(network, c.period, lumped.Fourier(n_samples=1600))
    return np.asarray(beat.pressure("distal")) / lumped.MMHG, np.asarray(beat.flow("ostium"))


def solvers():
    return [
        pytest.param(own_solver(320), Physics(), id="exact"),
        pytest.param(own_solver(320), Physics(linear=False), id="rosenbrock"),
        pytest.param(zerod.solve_members, Physics(), id="zerod", marks=needs_svzerod),
    ]


@pytest.mark.parametrize(("solver", "physics"), solvers())
def test_without_an_effect_the_circuit_is_the_surrogate(solver, physics):
    patient = draw_patient(np.random.default_rng(8))
    members = [ForeignMember(patient, c, False) for c in patient.conditions]
    plans = {c.name: regular_plan(1) for c in patient.conditions}
    for member, run in zip(
        members, solver(members, EffectForm(physics=physics), plans), strict=True
    ):
        P, Q = lumped_beat(patient, member.condition)
        inside = (run.t > -1e-9) & (run.t < member.condition.period - 1e-9)
        t = np.arange(P.size) / P.size * member.condition.period
        assert abs(run.P_distal[inside].mean() / P.mean() - 1.0) < 1e-4
        assert abs(run.Q[inside].mean() / Q.mean() - 1.0) < 1e-4
        # steps of T/250 to T/320 at the bends of the driving pressures
        error = run.P_distal[inside] / np.interp(run.t[inside], t, P) - 1.0
        assert np.abs(error).max() < 5e-3


@pytest.mark.parametrize("generator", ALL)
def test_a_null_has_no_difference(generator):
    record = module_of(generator).with_form(EffectForm(), np.random.default_rng(4))
    assert record.truth["lambda"] == 0.0
    for traces in record.truth["traces"].values():
        assert np.array_equal(traces["with"]["P_distal"], traces["without"]["P_distal"])


class Change:
    """What an effect changes in a record, by condition."""

    def __init__(self, record):
        self.size, self.form = record.truth["size"], record.truth["form"]
        self.traces = record.truth["traces"]

    def of(self, key, name):
        """With minus without, as an array or a number."""
        both = self.traces[name]
        return both["with"][key] - both["without"][key]

    def same(self, key, *names):
        return all(np.abs(self.of(key, n)).max() < SAME_MMHG for n in names or self.traces)

    def signs(self, key, *names):
        return {int(np.sign(np.mean(self.of(key, n)))) for n in names or self.traces}


STRESSED = ("adenosine", "dobutamine", "dobutamine_high")


def more_resistance(change):
    larger = change.size.get("factor", 2.0) > 1.0 or change.form == "in_series"
    return change.signs("ffr") == {-1 if larger else 1}


def more_stress_resistance(change):
    sign = -1 if change.size["factor"] > 1.0 else 1
    return change.same("P_distal", "rest") and change.signs("ffr", *STRESSED) == {sign}


def dilated(*names):
    def holds(change):
        sign = 1 if change.size.get("factor", change.size.get("R_1_factor")) < 1.0 else -1
        others = [n for n in change.traces if n not in names]
        return change.same("P_distal", *others) and change.signs("mean_flow", *names) == {sign}

    return holds


def reshaped(*names):
    """Traces change and their means do not."""

    def holds(change):
        others = [n for n in change.traces if n not in names]
        moved = all(np.abs(change.of("P_distal", n)).max() > 1e-3 for n in names)
        still = all(abs(change.of("ffr", n)) < 2e-3 for n in names)
        return moved and still and (not others or change.same("P_distal", *others))

    return holds


def regulated(change):
    """A bed below its usual pressure opens, one above it closes."""
    for traces in change.traces.values():
        below = change.size["usual_mmHg"] - traces["with"]["P_distal"].mean()
        flow = traces["with"]["mean_flow"] - traces["without"]["mean_flow"]
        if abs(below) > 8.0 and np.sign(flow) != np.sign(below):
            return False
    return True


def only(sensor, other):
    def holds(change):
        moved = all(np.abs(change.of(sensor, n)).max() > 1e-3 for n in change.traces)
        return moved and change.same(other)

    return holds


def either_delayed(change):
    late = ("P_aorta", "P_distal") if change.form == "aortic_late" else ("P_distal", "P_aorta")
    return only(*late)(change)


def drifted(change):
    end = max(change.traces, key=lambda n: np.abs(change.of("P_distal", n)).max())
    offset = change.of("P_distal", end)
    return change.same("P_distal", "rest") and np.allclose(offset, change.size["last_mmHg"])


def offset(key, sign):
    def holds(change):
        size = change.size.get("cm", change.size.get("mmHg"))
        return change.signs(key) == {int(sign * np.sign(size))}

    return holds


def collateral(change):
    """From the aorta it takes flow off the ostium and lifts the distal pressure."""
    if change.form.startswith("steady"):
        return any(abs(change.of("mean_flow", n)) > 1e-3 for n in change.traces)
    return change.signs("mean_flow") == {-1} and change.signs("ffr") == {1}


def reshaped_inlet(change):
    pairs = [(t["with"]["P_aorta"], t["without"]["P_aorta"]) for t in change.traces.values()]
    extremes = all(abs(a.max() - b.max()) < 1.5 and abs(a[0] - b[0]) < 0.5 for a, b in pairs)
    return extremes and all(np.abs(a - b).max() > 1e-2 for a, b in pairs)


def moved(change):
    return any(np.abs(change.of("P_distal", n)).max() > 1e-3 for n in change.traces)


EXPECTED = {
    "quadratic_loss": lambda change: change.signs("ffr") == {-1},
    "dynamic_narrowing": lambda change: change.signs("ffr") == {-1},
    "proximal_resistance": more_resistance,
    "stress_narrowing": more_stress_resistance,
    "inertance": reshaped("rest", *STRESSED),
    "vasodilation": dilated(*STRESSED),
    "adenosine_vasodilation": dilated("adenosine"),
    "r1_r3_dilation": dilated(*STRESSED),
    "autoregulation": regulated,
    "stress_compliance": reshaped(*STRESSED),
    "back_pressure": lambda change: change.signs("mean_flow") == {-1},
    "collateral_flow": collateral,
    "intramyocardial_pump": reshaped("rest", *STRESSED),
    "dobutamine_inotropy": reshaped("dobutamine", "dobutamine_high"),
    "wall_viscoelasticity": reshaped("rest", *STRESSED),
    "wire_drift": drifted,
    "sensor_height": offset("P_distal", -1),
    "aortic_zero_error": offset("P_aorta", 1),
    "catheter_damping": only("P_aorta", "P_distal"),
    "signal_delay": either_delayed,
    "aortic_waveform": reshaped_inlet,
}


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_changes_what_it_should(effect):
    for seed in range(4):
        rng = np.random.default_rng([seed, 77])
        record = other_forms.with_form(DRAWERS[effect](rng), rng)
        assert EXPECTED[effect](Change(record)), (record.truth["form"], record.truth["size"])


@needs_svzerod
@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_of_the_blocks_changes_what_it_should(effect):
    if effect == "intramyocardial_pump":  # a resistance that varies changes means as well
        expected = moved
    else:
        expected = EXPECTED[effect]
    for seed in range(2):
        rng = np.random.default_rng([seed, 78])
        record = zerod.with_form(BLOCKS[effect](rng), rng)
        assert expected(Change(record)), (record.truth["form"], record.truth["size"])


@pytest.mark.parametrize("kind", OUTSIDE)
def test_a_cause_outside_the_list_shows_in_irregular_beats(kind, tmp_path):
    rng = np.random.default_rng(91)
    record = real_clock.with_form(DRAWERS[f"outside:{kind}"](rng), rng)
    assert record.truth["truth"] == f"outside:{kind}"
    assert record.truth["lambda"] > 0.5
    record.write(tmp_path)
    read_record(tmp_path)


def test_visibility_discounts_what_the_patient_may_explain():
    """A shift by one prior sd along a known direction is worth at most 1, however clear it is; what
    no direction explains keeps its size."""
    rng = np.random.default_rng(0)
    columns = 30.0 * np.linalg.qr(rng.normal(size=(200, 4)))[0]
    nuisance = Nuisances(columns[:, :3], np.zeros(3, bool))
    assert visibility(nuisance, columns[:, 1]) == pytest.approx(30.0 / np.sqrt(901.0))
    assert visibility(nuisance, columns[:, 3]) == pytest.approx(30.0)
    assert visibility(nuisance, np.zeros(200)) == 0.0


def test_a_larger_effect_is_more_visible():
    found = []
    for size in (1.0, 4.0):
        form = EffectForm(
            sensors=lambda t, P_aorta, P_distal, c, size=size: (P_aorta, P_distal + size * c.order)
        )
        found.append(other_forms.with_form(form, np.random.default_rng(2)).truth["lambda"])
    assert found[1] == pytest.approx(4.0 * found[0], rel=0.02)  # ffr is a ratio, not linear


def test_command_writes_records_and_keeps_their_labels_apart(tmp_path, monkeypatch, capsys):
    call = ["foreign", "make", str(tmp_path / "set"), "--generator", "other_forms"]
    monkeypatch.setattr(sys, "argv", [*call, "--records", "2", "--seed", "4"])
    assert main() == 0
    labels = json.loads((tmp_path / "set" / "labels.json").read_text())
    assert labels["seed"] == 4
    assert set(labels["records"]) == {"0000", "0001"}
    needed = {"truth", "form", "size", "generator", "place", "lambda"}
    assert all(needed <= set(label) for label in labels["records"].values())
    inside = {p.name for p in (tmp_path / "set" / "records" / "0000").iterdir()}
    names = ("rest", "adenosine", "dobutamine", "dobutamine_high")
    assert inside == {"record.toml", *(f"{name}.csv" for name in names)}
    assert main() == 2
    assert "labels of a set already" in capsys.readouterr().err


def test_without_the_wheel_the_generator_says_what_to_install(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "svzerod", None)
    call = ["foreign", "make", str(tmp_path / "set"), "--generator", "zerod", "--records", "1"]
    monkeypatch.setattr(sys, "argv", call)
    assert main() == 2
    assert "pip install" in capsys.readouterr().err


def test_a_true_waveform_beside_the_effect_is_struck_out_of_the_answer(tmp_path):
    other = {"family": "ejection", "lambda": 90.0}
    labels = {
        "0000": {"truth": "inertance", "lambda": 9.0, "background": other},
        "0001": {"truth": "inertance", "lambda": 9.0, "background": other},
        "0002": {"truth": "none", "lambda": 0.0, "background": other},
    }
    alone = {"verdict": "named", "named": ["aortic_waveform"]}
    alone["probabilities"] = {"aortic_waveform": 0.9, "unknown": 0.1}
    both = {"verdict": "named", "named": ["inertance", "aortic_waveform"]}
    both["probabilities"] = {"inertance+aortic_waveform": 0.8, "aortic_waveform": 0.2}
    answers = {"0000": both, "0001": alone, "0002": alone}
    (tmp_path / "labels.json").write_text(json.dumps({"records": labels}))
    (tmp_path / "answers-own.json").write_text(json.dumps(answers))
    found, hidden, waveform = joined(tmp_path, "own")
    assert found["named"] == ["inertance"]
    assert ranked_first(found) == "inertance"
    assert hidden["verdict"] == "no_gap"
    assert hidden["probabilities"] == {"none": 0.9, "unknown": 0.1}
    assert waveform["truth"] == "aortic_waveform"
    assert waveform["named"] == ["aortic_waveform"]
