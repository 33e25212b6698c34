import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from calibration import DampedGaussNewton


def solve(fn, start, **options):
    return optx.least_squares(
        fn, DampedGaussNewton(**options), jnp.asarray(start), throw=False, max_steps=200
    )


def test_rosenbrock_and_powell_are_solved():
    def rosenbrock(y, _):
        return jnp.stack([10.0 * (y[1] - y[0] ** 2), 1.0 - y[0]])

    found = solve(rosenbrock, [-1.2, 1.0])
    np.testing.assert_allclose(found.value, [1.0, 1.0], rtol=1e-9)  # zero residual

    def powell(y, _):  # singular at the solution
        a, b, c, d = y
        return jnp.stack([a + 10 * b, 5**0.5 * (c - d), (b - 2 * c) ** 2, 10**0.5 * (a - d) ** 2])

    found = solve(powell, [3.0, -1.0, 0.0, 1.0])
    assert found.result == optx.RESULTS.successful
    # quartic: the cost's tolerance 1e-18 allows its fourth root
    np.testing.assert_allclose(found.value, 0.0, atol=1e-4)


def test_start_damping_does_not_depend_on_the_scale_of_the_residuals():
    t = jnp.linspace(0.0, 3.0, 20)

    def decay(y, scale):
        return scale * (jnp.exp(y[0] - jnp.exp(y[1]) * t) - 2.0 * jnp.exp(-0.7 * t))

    def steps(scale):
        solver = DampedGaussNewton(atol=0.0)
        found = optx.least_squares(decay, solver, jnp.array([2.0, 1.5]), args=scale)
        return int(found.stats["num_steps"])

    counts = [steps(jnp.asarray(scale)) for scale in (1e-4, 1.0, 1e6)]
    assert max(counts) - min(counts) <= 1


def test_undetermined_variables_stay_where_they_started():
    def product(y, _):
        return jnp.stack([y[0] + y[1] - 3.0, 0.0 * y[2]])

    found = solve(product, [1.0, 0.0, 7.0])
    # the nearest solution, and no step at all in the third
    np.testing.assert_allclose(found.value, [2.0, 1.0, 7.0], rtol=1e-9)


def test_trial_points_that_are_not_finite_are_refused():
    def residual(y, _):
        return jnp.stack([jnp.log(y[0]) + 4.0])

    found = solve(residual, [5.0])  # the first full step lands at a negative value
    np.testing.assert_allclose(found.value, jnp.exp(-4.0), rtol=1e-9)
    assert solve(residual, [-1.0]).result == optx.RESULTS.nonfinite


def test_batch_equals_loop():
    def residual(y, a):
        return jnp.stack([y[0] ** 2 - a, jnp.exp(y[1]) - y[0] * a, 0.1 * y[1]])

    def one(a):
        return optx.least_squares(residual, DampedGaussNewton(), jnp.array([1.0, 0.0]), a).value

    a = jnp.array([0.5, 2.0, 30.0])
    # the same operations lane by lane, up to reordered sums
    np.testing.assert_allclose(jax.vmap(one)(a), jnp.stack([one(x) for x in a]), rtol=1e-8)
