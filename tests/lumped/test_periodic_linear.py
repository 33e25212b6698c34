"""Linear periodic states: exact solutions, solvers against each other and against tight diffrax."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    RCR,
    Constant,
    Coronary,
    Cycles,
    FlowSource,
    Fourier,
    Network,
    PressureSource,
    Propagator,
    Resistance,
    Shooting,
    Sinusoid,
    Surrogate,
    Vessel,
    VesselCRL,
    connect,
    driven,
    ffr_divider,
    march,
    mean_state,
    pressure_ratio,
    solve_periodic,
    stress_rule,
)
from lumped.march import aligned_times
from lumped.units import MMHG
from lumped.verification import (
    BLOCKS,
    PERIOD,
    VESSELS,
    Pulse,
    coronary_behind_vessel,
    coronary_driven_by_flow,
    impedance,
    pulsed_coronary,
    vessel_impedance,
)

BED: Coronary = BLOCKS["coronary"]
FLOW = Sinusoid(mean=1.1, amplitude=0.8, period=PERIOD, phase=0.3)
AORTA = Sinusoid(mean=90.0 * MMHG, amplitude=25.0 * MMHG, period=PERIOD, phase=-1.0)
P_SYSTOLIC = 110.0 * MMHG


@pytest.fixture(scope="module")
def surrogate(rest) -> Network:
    return Surrogate(R0=5e3).network(rest)


@pytest.fixture(scope="module")
def reference(surrogate, solved):
    """The surrogate by the accuracy reference with four times its usual steps."""
    return solved(surrogate, 0.8, Propagator(2048))


# Exact solutions with a moving intramyocardial pressure.


@pytest.mark.parametrize(
    ("solver", "tolerance"), [(Fourier(64), 1e-12), (Propagator(128), 1e-10), (Shooting(256), 2e-8)]
)
def test_coronary_bed_behind_a_vessel_matches_the_harmonic_balance(solver, tolerance, solved):
    network = connect(
        {
            "inlet": (PressureSource(AORTA), "aorta"),
            "ostium": (Vessel(5e3, C=1e-7), "aorta", "distal"),
            "coronary": (BED, "distal"),
        }
    )
    found = solved(network, PERIOD, solver)
    exact = coronary_behind_vessel(found.t, BED, AORTA, 5e3, 1e-7)
    # Fourier: rounding, both sources being one harmonic; the others: their error in 128, 256 steps
    size = 100.0 * MMHG
    np.testing.assert_allclose(found.pressure("distal"), exact.P, rtol=0, atol=tolerance * size)
    np.testing.assert_allclose(found.state("coronary", "P_a"), exact.P_a, atol=tolerance * size)
    np.testing.assert_allclose(found.state("coronary", "y_im"), exact.y, atol=tolerance * size)
    np.testing.assert_allclose(found.flow("coronary"), exact.Q, atol=20 * tolerance * 1.0)
    # the term C_im dP_im/dt is what is tested here: without it the answer is another
    still = eqx.tree_at(lambda b: b.P_im.amplitude, BED, jnp.zeros(()))
    quiet = coronary_behind_vessel(found.t, still, AORTA, 5e3, 1e-7)
    assert np.max(np.abs(quiet.P - exact.P)) > 0.01 * size


def test_coronary_bed_driven_by_flow_matches_the_harmonic_balance(solved):
    found = solved(driven(BED, FLOW), PERIOD, Fourier(64))
    exact = coronary_driven_by_flow(found.t, BED, FLOW)
    size = np.max(np.abs(exact.P))
    np.testing.assert_allclose(found.pressure("port"), exact.P, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(found.state("block", "y_im"), exact.y, rtol=0, atol=1e-12 * size)


def test_intramyocardial_pressure_of_another_frequency_superposes(solved):
    bed = eqx.tree_at(lambda b: b.P_im.period, BED, jnp.asarray(PERIOD / 3))
    found = solved(driven(bed, FLOW), PERIOD, Fourier(64))
    exact = coronary_driven_by_flow(found.t, bed, FLOW)
    np.testing.assert_allclose(found.pressure("port"), exact.P, rtol=1e-12)


@pytest.mark.parametrize("solver", [Propagator(64), Shooting(512)])
def test_jumps_of_the_intramyocardial_pressure_are_harmless(solver, solved):
    bed = eqx.tree_at(lambda b: b.P_im, BED, Pulse(90.0 * MMHG, 0.1, 0.37, PERIOD))
    found = solved(driven(bed, Constant(1.1)), PERIOD, solver)
    exact = pulsed_coronary(found.t, bed, 1.1)
    size = np.max(np.abs(exact), axis=0)
    # exact but for the matrix exponentials in the propagator; 512 steps of order 5 otherwise
    tolerance = 5e-12 if isinstance(solver, Propagator) else 1e-8
    assert np.max(np.abs(np.asarray(found.z[:, :2]) - exact) / size) < tolerance


@pytest.mark.parametrize("order", [1, 3, 5])
def test_jumps_do_not_cost_the_march_its_order(order):
    bed = eqx.tree_at(lambda b: b.P_im, BED, Pulse(90.0 * MMHG, 0.1, 0.37, PERIOD))
    network = driven(bed, Constant(1.1))
    start = jnp.zeros(network.n_unknowns).at[:2].set(pulsed_coronary([0.0], bed, 1.1)[0])
    run = jax.jit(lambda ts: march(ts, network, start, order=order).z[-1, :2])
    errors = []
    for steps in (24, 48):
        end = run(aligned_times(network, PERIOD, steps, grading=0.0))
        errors.append(float(jnp.max(jnp.abs(end - start[:2]))))
    assert np.log2(errors[0] / errors[1]) > order - 0.4, errors


# Vessels against hand-made impedances.


@pytest.mark.parametrize("name", [name for name in VESSELS if VESSELS[name].is_linear])
def test_vessel_before_a_windkessel_matches_its_impedance(name, solved):
    vessel, bed = VESSELS[name], BLOCKS["rcr"]
    source = Sinusoid(mean=80.0, amplitude=60.0, period=PERIOD)
    network = connect(
        {"heart": (FlowSource(source), "in"), "vessel": (vessel, "in", "out"), "bed": (bed, "out")}
    )
    # an inertance behind a flow source makes index 2
    found = solved(network, PERIOD, Fourier(32, reduce=False))
    s = 2j * np.pi / PERIOD
    Z = complex(vessel_impedance(vessel, impedance(bed, s), s))
    R = float(vessel.R_viscous + bed.R_proximal + bed.R_distal)
    oscillation = (60.0 * Z * np.exp(s * np.asarray(found.t))).real
    expected = float(bed.P_ref) + 80.0 * R + oscillation
    np.testing.assert_allclose(found.pressure("in"), expected, rtol=1e-12)
    # volume: what enters and does not leave is stored in the compliances
    entering, leaving = found.mean_flow("vessel"), -found.mean_flow("vessel", 1)
    assert float(entering) == pytest.approx(float(leaving), rel=1e-13)


def test_index_two_network_matches_its_impedance(solved):
    vessel, bed = VesselCRL(R_viscous=60.0, C=2e-5, L=2.0), BLOCKS["rcr"]
    network = connect(
        {"inlet": (PressureSource(AORTA), "in"), "v": (vessel, "in", "out"), "bed": (bed, "out")}
    )
    s = 2j * np.pi / PERIOD
    load = complex(impedance(bed, s))
    R = float(vessel.R_viscous + bed.R_proximal + bed.R_distal)
    P_hat = 25.0 * MMHG * np.exp(-1j)
    series = P_hat / (60.0 + 2.0 * s + load)
    for solver, tolerance in ((Fourier(32, reduce=False), 1e-11), (Shooting(128), 1e-5)):
        found = solved(network, PERIOD, solver)
        turn = np.exp(s * np.asarray(found.t))
        Q_out = (90.0 * MMHG - float(bed.P_ref)) / R + (series * turn).real
        Q_in = Q_out + (s * 2e-5 * P_hat * turn).real
        # the flow into the compliance is a derivative of the source: order 3 in the march
        np.testing.assert_allclose(found.flow("bed"), Q_out, rtol=tolerance)
        np.testing.assert_allclose(found.flow("v"), Q_in, rtol=0, atol=20 * tolerance)
    with pytest.raises(ValueError, match="not an ordinary differential equation"):
        Propagator()(network, PERIOD)


# The surrogate: solvers against tight diffrax and each other.


def test_propagator_and_shooting_match_tight_diffrax(surrogate, solved, tight_cycle):
    fine = solved(surrogate, 0.8, Propagator())
    shot = solved(surrogate, 0.8, Shooting(512))
    ts = np.concatenate([fine.t[::8], shot.t[::8]])
    # an error of the start would shrink to 3 % in each cycle before the last and so be seen
    z = tight_cycle(surrogate, 0.8, ts, fine.initial[:3], cycles=4)
    for solution, truth in ((fine, z[: fine.t.size // 8]), (shot, z[fine.t.size // 8 :])):
        error = np.abs(np.asarray(solution.z[::8]) - truth)
        # the promise: 1e-8 of the systolic pressure
        assert np.max(error[:, :5]) < 1e-8 * P_SYSTOLIC
        assert np.max(error[:, 5:]) < 1e-7 * np.max(np.abs(truth[:, 5:]))
    # the propagator is three orders better
    assert (
        np.max(np.abs(np.asarray(fine.z[::8]) - z[: fine.t.size // 8])[:, :5]) < 1e-11 * P_SYSTOLIC
    )


def largest_error(solution, reference, n: int = 3) -> float:
    """Largest error of any state over the cycle, relative to its largest value."""
    network, ts = reference.network, np.append(solution.t, solution.period)
    between = np.concatenate([ts[:-1] + share * np.diff(ts) for share in np.arange(32) / 32])
    marks = np.asarray(network.breakpoints(solution.period))
    dense = np.unique(np.concatenate([between, marks]))
    path = jax.jit(march)(jnp.asarray(dense), network, reference.initial)
    truth = np.asarray(path.z)[np.searchsorted(dense, ts[:-1]), :n]
    size = np.max(np.abs(path.z[:, :n]), axis=0)
    return float(np.max(np.abs(np.asarray(solution.z[:, :n]) - truth) / size))


@pytest.mark.parametrize(
    ("solver", "bound"),
    [
        (Fourier(128), 1e-3),
        (Propagator(64), 1e-6),
        (Shooting(64), 1e-4),
        (Shooting(64, order=3), 3e-3),
        (Shooting(64, order=1), 0.2),
    ],
    ids=str,
)
def test_error_estimate_is_honest(solver, bound, surrogate, reference, solved):
    solution = solved(surrogate, 0.8, solver)
    error = largest_error(solution, reference)
    assert error < bound
    assert error / 3.0 < float(solution.error_estimate) < 1e3 * error


@pytest.mark.slow  # the adaptive solver takes half a minute to compile
def test_cycles_agree_with_the_propagator(rest, solved):
    # one state keeps the compilation of the adaptive solver short
    network = connect(
        {
            "heart": (FlowSource(Sinusoid(80.0, 60.0, PERIOD)), "root"),
            "bed": (RCR(120.0, 9e-4, 700.0), "root"),
        }
    )
    exact = solved(network, PERIOD, Fourier(32))
    slow = solved(network, PERIOD, Cycles(rtol=1e-9, atol=1e-6, n_samples=32))
    size = float(jnp.max(exact.pressure("root")))
    error = float(jnp.max(jnp.abs(slow.pressure("root") - exact.pressure("root")))) / size
    assert error < 1e-6
    assert error / 3.0 < float(slow.error_estimate) < 1e-4
    np.testing.assert_allclose(slow.mean, exact.mean, rtol=1e-7)
    # forgetting takes cycles: their number follows from the multiplier
    assert float(slow.floquet_multiplier) == pytest.approx(
        np.exp(-PERIOD / (700.0 * 9e-4)), rel=1e-6
    )
    assert int(slow.iterations) <= slow.cycles_to(1e-9) + 3


def test_all_solvers_find_the_exact_means(surrogate, solved):
    direct = mean_state(surrogate, 0.8)
    expected = ffr_divider(5e3, surrogate["coronary"].R_total)
    for solver, tolerance in ((Fourier(), 1e-12), (Propagator(), 1e-12), (Shooting(512), 1e-11)):
        solution = solved(surrogate, 0.8, solver)
        # Shooting integrates its own march: the mean is of the order of the scheme
        np.testing.assert_allclose(solution.mean, direct, rtol=tolerance)
        assert float(pressure_ratio(solution)) == pytest.approx(float(expected), rel=tolerance)


def test_ratio_is_the_divider_for_random_patients(rest):
    draws = np.random.default_rng(4).uniform(size=(200, 8))

    def case(u):
        R0, alpha = 10 ** (2.5 + 2 * u[0]), 10 ** (-1.5 + 2 * u[1])
        scale = 10 ** (u[2:7] - 0.5)
        names = ("R_1", "R_2", "R_3", "C_a", "C_im")
        base = Surrogate(R0=R0, alpha=alpha)
        changes = [getattr(base.coronary, name) * s for name, s in zip(names, scale, strict=True)]
        bed = eqx.tree_at(
            lambda b: [*(getattr(b, name) for name in names), b.P_venous, b.im_factor],
            base.coronary,
            [*changes, 12.0 * MMHG * u[7], u[3]],
        )
        patient = eqx.tree_at(lambda s: s.coronary, base, bed)
        network = patient.network(rest, rule=stress_rule("printed"))
        solution = solve_periodic(network, rest.period, Fourier(32), throw=False)
        R_total = network["coronary"].R_total
        expected = ffr_divider(R0, R_total, solution.mean_pressure("aorta"), bed.P_venous)
        return pressure_ratio(solution), expected

    ratio, expected = jax.jit(jax.vmap(case))(jnp.asarray(draws))
    assert 0.1 < float(jnp.min(ratio)) < float(jnp.max(ratio)) < 1.0
    np.testing.assert_allclose(ratio, expected, rtol=1e-12)


def test_floquet_multiplier_is_the_decay_of_a_disturbance(surrogate, reference):
    ts = aligned_times(surrogate, 0.8, 256, cycles=2)
    start = reference.initial.at[0].add(3e4).at[2].add(-2e4)
    path = jax.jit(march)(ts, surrogate, start)
    gap = path.z[:, :3] - reference.initial[None, :3]
    cycle = (ts.size - 1) // 2
    observed = gap[2 * cycle] / gap[cycle]
    # after one cycle only the slowest mode is left; the rest has shrunk by exp(-0.8/0.01)
    np.testing.assert_allclose(observed, reference.floquet_multiplier, rtol=1e-6)
    assert reference.cycles_to(1e-8) == pytest.approx(
        np.log(1e-8) / np.log(reference.floquet_multiplier)
    )


def test_multipliers_of_all_solvers_agree(surrogate, reference, solved):
    index_two = solved(surrogate, 0.8, Fourier(32, reduce=False))
    for solution in (
        index_two,
        solved(surrogate, 0.8, Fourier()),
        solved(surrogate, 0.8, Shooting(512)),
    ):
        # the multiplier of a march has the error of the march
        assert solution.floquet_multiplier == pytest.approx(reference.floquet_multiplier, rel=1e-6)


# Derivatives, batches, conservation.


@pytest.mark.parametrize("solver", [Fourier(32), Propagator(32), Shooting(32)], ids=str)
def test_periodic_state_has_an_exact_gradient(solver, rest, assert_gradient):
    patient = Surrogate(R0=5e3, alpha=0.7)
    patient = eqx.tree_at(lambda s: s.coronary.P_venous, patient, jnp.asarray(5.0 * MMHG))

    def probe(case):
        condition, (R0, alpha, C0, bed) = case
        model = eqx.tree_at(
            lambda s: (s.R0, s.alpha, s.C0, s.coronary), patient, (R0, alpha, C0, bed)
        )
        s = solve_periodic(model.network(condition), condition.period, solver, throw=False)
        values = s.mean_pressure("distal") + s.pressure("distal")[7] + s.pressure("distal")[20]
        return values / P_SYSTOLIC + s.mean_flow("coronary") + 0.3 * s.flow("coronary")[13]

    parameters = (patient.R0, patient.alpha, patient.C0, patient.coronary)
    assert_gradient(probe, (rest, parameters), tolerance=1e-6)


def test_periodic_state_of_a_batch_equals_a_loop(rest):
    def run(alpha):
        network = Surrogate(R0=5e3, alpha=alpha).network(rest)
        return [
            solve_periodic(network, rest.period, solver, throw=False).z
            for solver in (Fourier(32), Propagator(32))
        ]

    alphas = jnp.array([0.1, 1.3])
    one = jax.jit(run)
    for batch, first, second in zip(
        jax.jit(jax.vmap(run))(alphas), one(alphas[0]), one(alphas[1]), strict=True
    ):
        size = np.max(np.abs(first), axis=0)
        assert np.max(np.abs(batch[0] - first) / size) < 1e-12
        assert np.max(np.abs(batch[1] - second) / size) < 1e-12


def test_volume_is_conserved_at_every_node(surrogate, reference):
    z = reference
    np.testing.assert_allclose(z.flow("inlet"), -z.flow("ostium"), atol=1e-13)
    np.testing.assert_allclose(z.flow("coronary"), -z.flow("ostium", 1), atol=1e-13)
    stored = float(z.mean_flow("ostium") + z.mean_flow("ostium", 1))
    assert abs(stored) < 1e-13


# What is refused.


def test_solver_of_another_period_is_refused(surrogate):
    with pytest.raises(ValueError, match=r"repeats after 0\.8 s, the cycle is 0\.9 s"):
        solve_periodic(surrogate, 0.9)
    harmonic = driven(RCR(1.0, 1.0, 1.0), Sinusoid(1.0, 1.0, 0.4))
    assert float(solve_periodic(harmonic, 0.8, Fourier(16)).mean_flow("block")) == pytest.approx(
        1.0
    )
    with pytest.raises(ValueError, match="repeats after"):
        solve_periodic(harmonic, 0.6)
    for period in (0.0, -0.8, float("nan")):
        with pytest.raises(ValueError, match="must be positive"):
            solve_periodic(harmonic, period)


def test_network_without_an_answer_is_refused():
    fed = FlowSource(Constant(1.0))
    stuck = connect(
        {"a": (fed, "in"), "vessel": (Vessel(1.0, C=1e-4), "in", "out"), "b": (fed, "out")}
    )
    with pytest.raises(RuntimeError, match=r"No solution was found.*cut off"):
        solve_periodic(stuck, 0.8, Fourier(16))
    pressure = PressureSource(Constant(1.0))
    clash = connect({"a": (pressure, "n"), "b": (pressure, "n")})
    with pytest.raises(ValueError, match="not an ordinary differential equation"):
        solve_periodic(clash, 0.8, Fourier(16))


def test_network_without_states_is_solved(solved):
    network = connect({"a": (PressureSource(AORTA), "n"), "b": (Resistance(2e3), "n")})
    for solver in (None, Fourier(16), Shooting(16)):
        solution = solved(network, PERIOD, solver)
        expected = jax.vmap(AORTA)(solution.t) / 2e3
        np.testing.assert_allclose(solution.flow("b"), expected, rtol=1e-12)
        assert solution.floquet_multiplier == 0.0
        assert solution.cycles_to(1e-9) == 1.0


@pytest.mark.parametrize("C0", [1e-10, 1e-13])
def test_stiff_networks_are_solved(C0, rest, solved, reference):
    stiff = Surrogate(R0=5e3, C0=C0).network(rest)
    fast = solved(stiff, 0.8, Propagator(64))
    expected = solved(Surrogate(R0=5e3, C0=1e-9).network(rest), 0.8, Propagator(64))
    # time constants 1e-6 s and less: nothing is left of them but a shift of C0 R0 in time
    np.testing.assert_allclose(fast.z[:, 1], expected.z[:, 1], rtol=1e-4)
    assert fast.floquet_multiplier == pytest.approx(reference.floquet_multiplier, rel=1e-3)
    assert np.all(np.isfinite(solved(stiff, 0.8, Fourier(32)).monodromy))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Fourier(5),
        lambda: Fourier(50),
        lambda: Fourier(0),
        lambda: Propagator(0),
        lambda: Shooting(0),
        lambda: Shooting(order=2),
        lambda: Shooting(tolerance=0.0),
    ],
)
def test_impossible_options_are_refused(make):
    with pytest.raises(ValueError, match="must be"):
        make()
