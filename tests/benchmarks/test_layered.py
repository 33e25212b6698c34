"""The bed of three muscle layers: steady flow, periodicity, step size, and its forms of effects."""

import functools

import numpy as np
import pytest

import lumped
from benchmarks.foreign import EFFECTS, layered
from benchmarks.foreign.clock import Acquisition, see
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.layered_bed import draw_bed, single_compartment, towards
from benchmarks.foreign.layered_catalogue import KINDS, LAYERED_DRAWERS, LAYERED_OUTSIDE
from benchmarks.foreign.layered_march import LayeredCircuit
from benchmarks.foreign.layered_solver import layered_solver, stacked_parameters
from benchmarks.foreign.members import ForeignMember
from benchmarks.foreign.patient import draw_patient
from benchmarks.foreign.waves import regular_plan

BY_NAME = [pytest.param(k, id=f"{k.effect.removeprefix('outside:')}-{k.form}") for k in KINDS]


@functools.cache
def scene(seed=3, beats=1):
    """A patient, layers, members without an effect, and plans."""
    rng = np.random.default_rng(seed)
    patient = draw_patient(rng)
    bed, _ = layered.calibrated(patient, draw_bed(rng), 0.8)
    members = [ForeignMember(patient, c, False) for c in patient.conditions]
    return patient, bed, members, {c.name: regular_plan(beats) for c in patient.conditions}


def steady(P_aorta, P_ventricle, members):
    def drive(phase, beat):
        one = np.ones((phase.size, len(members)))
        return P_aorta * one, P_ventricle * one

    return drive


def test_steady_flow_is_that_of_the_resistances():
    _, bed, members, _ = scene()
    p = stacked_parameters(members, EffectForm(), bed._replace(power=(0.0, 0.0)))
    period = np.array([m.condition.period for m in members])
    _, beat = LayeredCircuit(p, period, steady(80.0, 30.0, members)).settle(100)
    total = p["R0"] + p["R1"] + 1.0 / (1.0 / (p["R2"] + p["R3"])).sum(axis=0)
    np.testing.assert_allclose(beat[-1, 1], 80.0 / total, rtol=1e-4)
    np.testing.assert_allclose(beat[-1, 2], 80.0 - p["R0"] * 80.0 / total, rtol=1e-4)


def test_what_flows_in_over_a_beat_flows_out():
    _, bed, members, _ = scene()
    p = stacked_parameters(members, EffectForm(), bed._replace(power=(0.0, 0.0)))
    period = np.array([m.condition.period for m in members])

    def drive(phase, beat):
        P = 80.0 + 25.0 * np.sin(2.0 * np.pi * phase)
        pressed = 60.0 * (1.0 - np.cos(2.0 * np.pi * phase))
        return tuple(np.repeat(x[:, None], len(members), axis=1) for x in (P, pressed))

    _, beat = LayeredCircuit(p, period, drive).settle(200)
    flow_in, flow_out = beat[:, 1].mean(axis=0), (beat[:, 4:] / p["R3"]).sum(axis=1).mean(axis=0)
    np.testing.assert_allclose(flow_in, flow_out, rtol=2e-3)


def test_equal_layers_are_the_base_circuit():
    patient, _, members, plans = scene(8)
    for m, run in zip(
        members,
        layered_solver(single_compartment(), 800)(members, EffectForm(), plans),
        strict=True,
    ):
        c = m.condition
        surrogate = lumped.Surrogate(
            R0=patient.R0 * lumped.MMHG,
            alpha=patient.alpha,
            C0=patient.C0 / lumped.MMHG,
            coronary=lumped.nominal_coronary(
                C_a=patient.C_a / lumped.MMHG, C_im=patient.C_im / lumped.MMHG
            ),
        )
        network = surrogate.network(
            lumped.condition_from_clinic(c.P_systolic, c.P_diastolic, c.period),
            rule=lumped.stress_rule("printed") if c.stressed else None,
        )
        beat = lumped.solve_periodic(network, c.period, lumped.Fourier(n_samples=1600))
        P = np.asarray(beat.pressure("distal")) / lumped.MMHG
        inside = (run.t > -1e-9) & (run.t < c.period - 1e-9)
        t = np.arange(P.size) / P.size * c.period
        assert np.abs(run.P_distal[inside] - np.interp(run.t[inside], t, P)).max() < 0.3
        assert abs(run.P_distal[inside].mean() - P.mean()) < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_layers_stay_near_the_base_circuit(seed):
    rng = np.random.default_rng(seed)
    patient, bed = draw_patient(rng), draw_bed(rng)
    _, background = layered.calibrated(patient, bed, 0.8)
    assert 0.02 < background["distal_rms_mmHg"] < 1.0
    assert background["flow_share"] < 0.02
    flat = towards(bed, 0.0)
    assert np.array_equal(flat.squeeze, np.ones(3))
    assert flat.power == (0.0, 0.0)


def nonlinear_forms():
    names = ("quadratic_loss", "dynamic_narrowing", "autoregulation", "inertance")
    return [EffectForm(), *(LAYERED_DRAWERS[n](np.random.default_rng(6)) for n in names)]


@pytest.mark.parametrize("form", nonlinear_forms(), ids=lambda form: form.effect)
def test_half_the_step_and_more_beats_change_nothing(form):
    patient, bed, _, plans = scene(2)
    members = [ForeignMember(patient, c, True) for c in patient.conditions]
    rough = layered_solver(bed, layered.steps_of(form))(members, form, plans)
    fine = layered_solver(bed, 2 * layered.steps_of(form))(members, form, plans)
    for a, b in zip(rough, fine, strict=True):
        assert np.abs(a.P_distal - np.interp(a.t, b.t, b.P_distal)).max() < 0.1
    p = stacked_parameters(members, form, bed)
    period = np.array([c.period for c in patient.conditions])
    parts = (getattr(form, name, None) for name in ("law", "tone"))
    circuit = LayeredCircuit(p, period, steady(85.0, 0.0, members), *parts)
    state, first = circuit.settle(200)
    for _ in range(10):
        last = circuit.beat(state, -1, 200)
    assert np.abs(last[:, 2] - first[:, 2]).max() < 0.02


def seen_with(form, on, beats=2, steps=160):
    """What the sensors show with or without a form, of all conditions."""
    patient, bed, _, plans = scene(5, beats)
    times = {c.name: np.arange(beats * 100) / 100 * c.period + 1e-4 for c in patient.conditions}
    acquisition = Acquisition(times, dict.fromkeys(times, 0.0), 0.01, True)
    members = [ForeignMember(patient, c, on) for c in patient.conditions]
    runs = layered_solver(bed, steps)(members, form, plans)
    return [see(r, m, form, acquisition) for r, m in zip(runs, members, strict=True)]


@pytest.fixture(scope="module")
def plain():
    """What the sensors show of the bed alone."""
    return seen_with(EffectForm(), False)


def largest_change(form, plain):
    """Of pressures [mmHg], flows [mL/min] and stated pressures [mmHg]."""
    changes = [abs(form.stated_shift)]
    for a, b in zip(plain, seen_with(form, True), strict=True):
        changes += [np.abs(b.P_aorta - a.P_aorta).max(), np.abs(b.P_distal - a.P_distal).max()]
        changes.append(abs(b.mean_flow - a.mean_flow))
    return max(changes)


@pytest.mark.parametrize("kind", BY_NAME)
def test_a_form_of_size_zero_changes_nothing_and_others_do(kind, plain):
    assert largest_change(kind.make(kind.null), plain) < 0.02
    assert largest_change(kind.make(kind.draw(np.random.default_rng(1))), plain) > 0.1


def test_every_truth_has_a_form():
    assert set(LAYERED_DRAWERS) == {
        "none", *EFFECTS, *(f"outside:{name}" for name in LAYERED_OUTSIDE)
    }  # fmt: skip
    assert len(LAYERED_OUTSIDE) >= 6
