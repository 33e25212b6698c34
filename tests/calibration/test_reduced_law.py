import csv
import importlib.util
import pathlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import (
    LumenLosses,
    PressureFlowLaw,
    contraction_coefficient,
    lumen_law,
    lumen_losses,
)
from calibration.reduced_law import conductance, viscous_resistance
from jaxfsi import Lumen, read_ivus_contours
from lumped.units import ML_PER_MIN, MMHG
from study import demo_case_path

BUNDLED = demo_case_path().parent
MU, RHO = 0.04, 1.06

_spec = importlib.util.spec_from_file_location(
    "poisson", pathlib.Path(__file__).parent / "poisson.py"
)
assert _spec is not None
assert _spec.loader is not None
poisson = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(poisson)


def tube(s, major, minor=None, *, n: int = 400) -> Lumen:
    """Coaxial ellipses of given semi-axes; the polygons have exactly the area of the ellipses."""
    t = 2.0 * np.pi * np.arange(n) / n
    unit = np.stack([np.cos(t), np.sin(t)], axis=-1) / np.sqrt(
        np.sin(2 * np.pi / n) * n / 2 / np.pi
    )
    axes = np.stack([np.asarray(major), np.asarray(major if minor is None else minor)], axis=-1)
    return Lumen(jnp.asarray(axes[:, None, :] * unit), jnp.asarray(np.asarray(s, float)))


@pytest.fixture(scope="module")
def patient() -> Lumen:
    return read_ivus_contours(
        BUNDLED / "rest_diastole_contours.csv", frame_table=BUNDLED / "rest_frames.csv"
    )


@pytest.fixture(scope="module")
def coarse(patient) -> Lumen:
    """The patient with every fifth point, for the many evaluations of gradient checks."""
    return Lumen(patient.contours[:, ::5], patient.s)


# The law ΔP = R0 Q + K Q|Q|.

LAWS = [(500.0, 450.0), (5e3, 0.0), (0.0, 2e4)]


@pytest.mark.parametrize(("R0", "K"), LAWS)
def test_flow_inverts_pressure_drop_and_is_odd(R0, K):
    law = PressureFlowLaw(jnp.asarray(R0), jnp.asarray(K))
    Q = jnp.asarray([-30.0, -1e-9, 0.0, 1e-12, 1e-3, 2.0])
    # Rounding of a quadratic root without cancellation.
    np.testing.assert_allclose(law.flow(law.pressure_drop(Q)), Q, rtol=1e-12, atol=0.0)
    np.testing.assert_array_equal(law.flow(-Q), -law.flow(Q))


@pytest.mark.parametrize(("R0", "K"), LAWS)
def test_tangent_and_secant_are_those_of_the_curve(R0, K):
    law = PressureFlowLaw(jnp.asarray(R0), jnp.asarray(K))
    for dP in (4.0 * MMHG, 40.0 * MMHG, -40.0 * MMHG):
        slope = jax.grad(lambda Q, law=law: law.pressure_drop(Q))(law.flow(dP))
        # The same closed form by another way.
        np.testing.assert_allclose(law.tangent(dP), slope, rtol=1e-13)
        np.testing.assert_allclose(law.secant(dP), dP / law.flow(dP), rtol=1e-13)
    np.testing.assert_allclose(law.tangent(0.0), R0, atol=0.0)


@pytest.mark.parametrize("dP", [-40.0 * MMHG, 0.0, 1e-9, 4.0 * MMHG])
def test_flow_differentiates_in_all_arguments(dP):
    def flow(values):
        return PressureFlowLaw(values[0], values[1]).flow(values[2])

    values = jnp.asarray([500.0, 450.0, dP])
    gradient = jax.grad(flow)(values)
    # dQ/d(a, b, ΔP) = (−Q, −Q|Q|, 1)/(a + 2 b|Q|) by implicit differentiation; round-off.
    Q = flow(values)
    expected = np.array([-Q, -Q * abs(Q), 1.0]) / (values[0] + 2.0 * values[1] * abs(Q))
    np.testing.assert_allclose(gradient, expected, rtol=1e-12, atol=1e-18)


def test_flow_without_linear_part_has_finite_gradient_at_zero():
    gradient = jax.grad(lambda dP: PressureFlowLaw(0.0, 2e4).flow(dP))(0.0)
    assert np.isfinite(gradient)


def test_law_jit_and_batch_equal_eager_loop():
    law = PressureFlowLaw(jnp.asarray(500.0), jnp.asarray(450.0))
    dP = jnp.asarray([-5e4, 0.0, 1e3])
    eager = jnp.stack([law.flow(x) for x in dP])
    # Same arithmetic; fused multiply-adds may differ in the last place.
    np.testing.assert_allclose(eqx.filter_jit(PressureFlowLaw.flow)(law, dP), eager, rtol=1e-15)
    laws = PressureFlowLaw(jnp.asarray([500.0, 1e3]), jnp.asarray([450.0, 0.0]))
    batch = jax.vmap(lambda law: law.flow(dP))(laws)
    np.testing.assert_allclose(batch[0], eager, rtol=1e-15)
    np.testing.assert_allclose(batch[1], dP / 1e3, rtol=1e-15)


# The viscous part.


def test_straight_tube_matches_poiseuille():
    radius, length = 0.15, 3.0
    lumen = tube(np.linspace(0.0, length, 5), np.full(5, radius))
    a = lumen_law(lumen, mu=MU, rho=RHO).R0
    # Moment of a regular polygon of 400 points at the area of the disc: relative 4th-order error.
    np.testing.assert_allclose(a, 8.0 * MU * length / (np.pi * radius**4), rtol=1e-7)


def test_elliptic_tube_matches_analytic_resistance():
    A, B, length = 0.26, 0.065, 1.0
    a = lumen_law(tube([0.0, 0.4, length], [A] * 3, [B] * 3), mu=MU, rho=RHO).R0
    exact = 4.0 * MU * (A**2 + B**2) * length / (np.pi * A**3 * B**3)
    np.testing.assert_allclose(a, exact, rtol=1e-7)  # as above


def test_equivalent_ellipse_has_the_conductance_of_the_contour(patient):
    A, B = patient.equivalent_ellipse
    ellipse = np.pi * A**3 * B**3 / (4.0 * (A**2 + B**2))
    # The same quantity by another formula; round-off, amplified where A and B almost agree.
    np.testing.assert_allclose(ellipse, conductance(patient), rtol=1e-10)


def test_viscous_resistance_converges_with_second_order_along_a_cone():
    def error(n: int) -> float:
        s = np.linspace(0.0, 2.0, n + 1)
        lumen = tube(s, 0.2 - 0.05 * s)
        exact = 8.0 * MU / np.pi * (0.1**-3 - 0.2**-3) / (3.0 * 0.05)
        return abs(float(jnp.sum(viscous_resistance(lumen, mu=MU))) / exact - 1.0)

    rates = np.log2([error(16) / error(32), error(32) / error(64)])
    # The trapezoidal rule is of second order; the fourth-order remainder is below 1 % here.
    np.testing.assert_allclose(rates, 2.0, atol=0.02)


def test_poisson_reference_matches_analytic_ellipse():
    lumen = tube([0.0, 1.0], [2.7, 2.7], [0.65, 0.65])
    exact = np.pi * 2.7**3 * 0.65**3 / (4.0 * (2.7**2 + 0.65**2))
    G = poisson.duct_conductance(np.asarray(lumen.contours[0]), 0.05)
    assert abs(G / exact - 1.0) < 2e-3  # fourth order left after extrapolation; irregular mesh


def test_conductance_of_real_slits_matches_poisson_solution(patient):
    # Frames 0, 1, 2 are the slit at the ostium, 3 is the narrowest, 8 is round.
    mm = patient.contours[jnp.asarray([0, 1, 2, 3, 8])] * 10.0
    reduced = np.asarray(conductance(Lumen(mm, jnp.arange(5.0))))
    reference = np.array([poisson.duct_conductance(np.asarray(c), 0.05) for c in mm])
    # Measured errors: 0.0, -0.4, -0.6, +0.3, +0.2 %; the reference itself is good to 0.2 %.
    np.testing.assert_allclose(reduced, reference, rtol=0.012)


@pytest.mark.parametrize(
    ("state", "phase"),
    [
        ("rest", "systolic"),  # with the frame that is furthest off
        *(
            pytest.param(*which, marks=pytest.mark.slow)
            for which in (("rest", "diastolic"), ("stress", "diastolic"), ("stress", "systolic"))
        ),
    ],
)
def test_conductance_of_all_states_matches_poisson_solution(shared_data, state, phase):
    path = shared_data / "ivus_aaoca" / f"ivus_{state}" / f"{phase}_contours.csv"
    lumen = read_ivus_contours(path)
    mm = np.asarray(lumen.contours) * 10.0
    reference = np.array([poisson.duct_conductance(c, 0.04) for c in mm]) * 1e-4
    reduced = np.asarray(conductance(lumen))
    # Measured: -0.7 .. +1.3 %, but +3.3 % for the kinked frame 241 of rest, systole.
    np.testing.assert_allclose(reduced, reference, rtol=0.04)
    # Measured: -0.6 .. +0.1 % for the whole vessel, where the kinked frame weighs little.
    np.testing.assert_allclose(np.sum(1.0 / reduced), np.sum(1.0 / reference), rtol=0.01)


# Viscous resistance of the last 10 mm before the ostium, frames that lie wholly inside, at
# 4 mPa s [mmHg min/ml]: an independent computation from the same files, published to 1e-4 with
# the area-preserving ellipse of the caliper ratio, which reads 2-4 % lower on slits.
LAST_CENTIMETRE = {
    ("rest", "diastolic"): 0.0050,
    ("rest", "systolic"): 0.0055,
    ("stress", "diastolic"): 0.0055,
    ("stress", "systolic"): 0.0104,
}


@pytest.mark.parametrize(("state", "phase"), list(LAST_CENTIMETRE))
def test_resistance_of_the_last_centimetre(shared_data, state, phase):
    path = shared_data / "ivus_aaoca" / f"ivus_{state}" / f"{phase}_contours.csv"
    lumen = read_ivus_contours(path)
    n = int(jnp.sum(lumen.s <= 1.0))
    part = Lumen(lumen.contours[:n], lumen.s[:n])
    R = float(lumen_law(part, mu=0.04, rho=RHO).R0) / MMHG * ML_PER_MIN
    np.testing.assert_allclose(R, LAST_CENTIMETRE[state, phase], rtol=0.06)


# The quadratic part.


def test_sudden_expansion_matches_borda_carnot_momentum_balance():
    A1, A2 = np.pi * 0.1**2, np.pi * 0.3**2
    lumen = tube([0.0, 1.0, 1.0 + 1e-9, 2.0], [0.1, 0.1, 0.3, 0.3])
    b = lumen_law(lumen, mu=MU, rho=RHO, area_upstream=A1, development=0.0).K
    # Flat profiles: p1 − p2 = ρ Q² (1/A2² − 1/(A1 A2)), negative: the pressure recovers.
    np.testing.assert_allclose(b, RHO * (1.0 / A2**2 - 1.0 / (A1 * A2)), rtol=1e-10)


def test_entrance_of_a_long_tube_tends_to_the_developed_limit():
    lumen = tube([0.0, 1e4], [0.1, 0.1])
    losses = lumen_losses(lumen, mu=MU, rho=RHO)
    K = losses.b_development * 2.0 * (np.pi * 0.1**2) ** 2 / RHO
    # Limit of the joined formula for a disc, 3.44² · 4π / (2 · 16 · π) = 1.48; the exact limit is
    # 4/3 (Lundgren, Sparrow and Starr 1964), 1.25 in Shah's fit: 10 % or better is claimed.
    np.testing.assert_allclose(K, 3.44**2 / 8.0, rtol=1e-3)
    assert abs(K / (4.0 / 3.0) - 1.0) < 0.12


@pytest.mark.parametrize("x_plus", [0.002, 0.01, 0.02, 0.05])
def test_development_loss_matches_the_fit_of_shah_for_a_round_tube(x_plus):
    radius, Re = 0.1, 500.0
    Q = Re * MU / RHO * np.pi * radius / 2.0
    lumen = tube([0.0, x_plus * 2.0 * radius * Re], [radius, radius])
    losses = lumen_losses(lumen, mu=MU, rho=RHO, Q_reference=Q)
    K = losses.b_development * 2.0 * (np.pi * radius**2) ** 2 / RHO
    root = 3.44 / np.sqrt(x_plus)
    friction = root + (1.25 / (4.0 * x_plus) + 16.0 - root) / (1.0 + 2.1e-4 / x_plus**2)
    # Shah 1978 (2 % fit of numerical solutions); the joined formula claims 10 % of the whole
    # drop; in these velocity heads the two differ by less than 0.12 of up to 1.2.
    np.testing.assert_allclose(K, 4.0 * x_plus * (friction - 16.0), atol=0.12)


def test_contraction_coefficient_spans_flush_to_grazing():
    np.testing.assert_allclose(contraction_coefficient(np.pi / 2.0), 0.5, rtol=1e-12)
    np.testing.assert_allclose(contraction_coefficient(0.0), 1.0, rtol=1e-12)


def test_parts_add_up_to_the_law(patient):
    losses = lumen_losses(patient, mu=MU, rho=RHO)
    law = lumen_law(patient, mu=MU, rho=RHO)
    np.testing.assert_allclose(law.R0, jnp.sum(losses.a_frames), rtol=1e-14)  # same sum
    total = losses.b_entrance + losses.b_expansion + losses.b_head
    np.testing.assert_allclose(law.K, total, rtol=1e-14)  # same sum
    assert all(float(jnp.min(part)) >= 0.0 for part in jax.tree.leaves(losses))


def test_slit_dominates_the_patient(patient):
    losses = lumen_losses(patient, mu=MU, rho=RHO)
    share = jnp.sum(losses.a_frames[patient.s < 0.4]) / losses.a_viscous
    assert 0.5 < share < 1.0  # 4 of 24 mm hold most of the resistance
    law = losses.law
    # The ramp's tangent at 40 mmHg overstates the resistance at a resting gradient several-fold.
    assert law.tangent(40.0 * MMHG) > 4.0 * law.secant(4.0 * MMHG)


def test_reference_flow_matters_little(patient):
    b = [
        float(lumen_law(patient, mu=MU, rho=RHO, Q_reference=Q * ML_PER_MIN).K)
        for Q in (50.0, 100.0, 200.0)
    ]
    assert b[0] > b[1] > b[2]
    assert max(b[0] / b[1], b[1] / b[2]) < 1.1  # what the docstring of Q_REFERENCE promises


def _scaled(lumen: Lumen, scale) -> Lumen:
    return Lumen(lumen.contours * scale, lumen.s)


@pytest.mark.parametrize("coefficient", ["R0", "K"])
@pytest.mark.parametrize("what", ["scale", "mu", "rho", "stretch", "ripple"])
def test_law_differentiates_in_contours_and_blood(coarse, coefficient, what):
    x, y = coarse.contours[..., 0], coarse.contours[..., 1]
    ripple = jnp.stack([jnp.sin(20.0 * y), jnp.cos(15.0 * x)], axis=-1)

    def value(step):
        mu, rho, lumen = MU, RHO, coarse
        if what == "scale":
            lumen = _scaled(coarse, 1.0 + step)
        elif what == "mu":
            mu = MU * (1.0 + step)
        elif what == "rho":
            rho = RHO * (1.0 + step)
        elif what == "stretch":
            lumen = Lumen(coarse.contours, coarse.s * (1.0 + step))
        else:
            lumen = Lumen(coarse.contours + 0.01 * step * ripple, coarse.s)
        return getattr(lumen_law(lumen, mu=mu, rho=rho), coefficient)

    h = 1e-5
    central = (value(h) - value(-h)) / (2.0 * h)
    scale = abs(float(value(0.0)))
    # Central differences: truncation h² and round-off 1e-16/h of the value, below 1e-8.
    np.testing.assert_allclose(jax.grad(value)(0.0), central, rtol=1e-7, atol=1e-9 * scale)


def test_resistance_scales_with_the_fourth_power_of_size(coarse):
    slope = jax.grad(lambda k: lumen_law(_scaled(coarse, k), mu=MU, rho=RHO).R0)(1.0)
    a = lumen_law(coarse, mu=MU, rho=RHO).R0
    np.testing.assert_allclose(slope, -4.0 * a, rtol=1e-12)  # exact by dimensions; round-off


def test_gradients_are_finite_where_the_lumen_is_as_wide_as_upstream():
    lumen = tube([0.0, 1.0], [0.1, 0.1])
    gradient = jax.grad(lambda A: lumen_law(lumen, mu=MU, rho=RHO, area_upstream=A).K)
    assert np.isfinite(gradient(float(lumen.area[0])))
    assert np.isfinite(gradient(float("inf")))


def test_losses_jit_and_batch_equal_eager_loop(coarse):
    def losses(lumen: Lumen) -> LumenLosses:
        return lumen_losses(lumen, mu=MU, rho=RHO)

    scales = (1.0, 0.9)
    eager = [losses(_scaled(coarse, scale)) for scale in scales]
    jitted = eqx.filter_jit(losses)(coarse)
    many = jax.tree.map(lambda *x: jnp.stack(x), *[_scaled(coarse, scale) for scale in scales])
    batch = jax.vmap(losses)(many)
    for i, one in enumerate(eager):
        for left, right in zip(jax.tree.leaves(batch), jax.tree.leaves(one), strict=True):
            # Sums over points in another order.
            np.testing.assert_allclose(left[i], right, rtol=1e-11)
    for left, right in zip(jax.tree.leaves(jitted), jax.tree.leaves(eager[0]), strict=True):
        np.testing.assert_allclose(left, right, rtol=1e-11)


# The FDA nozzle: 12 mm pipe, cone of 22.685 mm, throat of 4 mm x 40 mm, sudden expansion to 12 mm;
# mu 3.5 mPa s, rho 1.056 g/cm3. Pressures from the tap 90 mm before to the tap 32 mm behind the
# expansion. Loss in heads of the throat, laboratories in increasing order (Hariharan et al. 2011,
# J Biomech Eng 133:041002, data doi 10.17917/C78G69):
#
#   Re     measured                     recovered   not recovered
#   500    2.42, 3.90, 4.41, 4.56       3.29        3.48
#   2000   1.99, 2.13, 2.14, 3.88       1.88        2.07
#   3500   1.70, 1.73, 1.82, 1.85, 2.21 1.59        1.79
#   5000   1.50, 1.55, 1.69, 1.97       1.45        1.65
#   6500   1.46, 1.48, 1.48, 1.57       1.37        1.57
#
# The last tap lies 8 throat diameters behind the step, where the jet has not widened yet (its
# centre-line velocity is above 80 % of the peak): "not recovered" is the case measured. It agrees
# with the laboratories from Re 2000 up. At Re 500 it lies inside the four of them, but below the
# three that agree; their pressures there are multiples of 0.1-0.2 mmHg, of 2.6 mmHg in all.
NOZZLE = [(500, 5.20624), (2000, 20.825), (3500, 36.4437), (5000, 52.0624), (6500, 67.6811)]


def _nozzle_loss(Q: float, *, recovered: bool) -> float:
    """Static pressure loss between the taps, in velocity heads of the throat."""
    s = np.concatenate([[-9.032], np.linspace(-6.2685, -4.0, 60), [0.0, 1e-9, 3.2]])
    radius = np.concatenate([[0.6], np.linspace(0.6, 0.2, 60), [0.2, 0.6, 0.6]])
    lumen = tube(s - s[0], radius, n=100)
    wide, narrow = np.pi * 0.6**2, np.pi * 0.2**2
    law = lumen_law(
        lumen,
        mu=0.035,
        rho=1.056,
        Q_reference=Q,
        area_upstream=wide,
        K_expansion=1.0 if recovered else (wide + narrow) / (wide - narrow),
    )
    return float(law.pressure_drop(Q)) / (1.056 / 2.0 * (Q / narrow) ** 2)


@pytest.mark.parametrize(("Re", "Q"), NOZZLE)
def test_fda_nozzle_loss_lies_within_the_laboratories(shared_data, Re, Q):
    with (shared_data / "fda_nozzle" / "summary_total_pressure_drop.csv").open() as file:
        measured = [
            float(row["loss_coefficient_K"])
            for row in csv.DictReader(file)
            if int(row["Re_throat"]) == Re and row["loss_coefficient_K"]
        ]
    loss = _nozzle_loss(Q, recovered=False)
    # Between the lowest and the highest laboratory; 1 % for the reading of the flow.
    assert min(measured) * 0.99 < loss < max(measured) * 1.01
    # Full recovery is what the law assumes for a vessel: less by 2 A_n/A_d (1 − A_n/A_d) heads.
    recovery = 2.0 / 9.0 * (1.0 - 1.0 / 9.0)
    np.testing.assert_allclose(_nozzle_loss(Q, recovered=True), loss - recovery, rtol=1e-6)


def test_fda_nozzle_loss_at_re_500_is_near_the_mean_of_the_laboratories():
    # Mean of four laboratories 3.82 with a standard deviation of 0.97; the law gives 3.48. The
    # lowest of the three that agree, 3.90, is missed by a tenth.
    np.testing.assert_allclose(_nozzle_loss(5.20624, recovered=False), 3.82, rtol=0.10)
