"""
Differentiate your own loss
===========================

Any scalar of a march can be differentiated with respect to any number of the model. Here the
outlet pressure of a tube was "measured", and the stiffness of the wall and the resistance of the
Windkessel are found from it by gradients through the coupled steps.

What to know beforehand:

- ``prepare`` stands outside the function that is differentiated, with a model of nearby numbers:
  its factors steer iterations, not the result.
- Unknowns are logarithms of factors: a step of descent then leaves E and R positive. Under ``jit``
  nothing checks them.
- ``value_and_grad`` returns what ``optax`` takes, in place of the optimiser of SciPy below.
- The first gradient compiles for about a minute. Many steps need ``march(..., recompute=True)``,
  which keeps few states. For the gradient with respect to everything in the model:
  ``eqx.filter_value_and_grad``.
"""

# %%
# A model whose numbers are arguments
# -----------------------------------
import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize

from jaxfsi import core, meshing
from lumped import MMHG, RCR, Sinusoid

mesh = meshing.tube(radius=0.5, length=2.0, thickness=0.1, n_around=6, n_axial=5, n_rings=2)
base = core.build_model(
    mesh,
    {
        "inlet": core.FlowPort(Sinusoid(4.0, 4.0, 0.1, np.pi)),
        "outlet": core.BlockPort(RCR(R_proximal=400.0, C=2e-5, R_distal=1500.0)),
    },
    wall=core.Wall(core.NeoHookean(1.5e6, 0.45), rho_s=1.1),
)
stepper = core.prepare(4e-3, base, tolerance=1e-6)  # its factors may be those of a nearby model
where = base.names.index("outlet")


def pressure(log_factors):
    """Outlet pressure over 25 steps [mmHg], with E and R_distal scaled."""
    model = eqx.tree_at(
        lambda m: (m.wall.material.E, m.ports[where].block.R_distal),
        base,
        (1.5e6 * jnp.exp(log_factors[0]), 1500.0 * jnp.exp(log_factors[1])),
    )
    run = core.march(model, core.initial_state(model), stepper, 25, throw=False)
    return run.history.P_port[:, where] / MMHG


# %%
# The loss, and its gradient in reverse mode
# ------------------------------------------
truth = jnp.log(jnp.array([0.6, 1.3]))
curve = eqx.filter_jit(pressure)
measured = curve(truth) + 0.02 * jax.random.normal(jax.random.key(0), (25,))


@jax.jit
@jax.value_and_grad
def loss(log_factors):
    """Mean square of what is missed, in units of the noise."""
    return jnp.mean(((pressure(log_factors) - measured) / 0.02) ** 2)


found = minimize(
    lambda x: [np.asarray(part) for part in loss(jnp.asarray(x))],
    np.zeros(2), jac=True, method="L-BFGS-B", options={"maxiter": 12},
)  # fmt: skip
E, R = np.exp(found.x)
print(f"loss {found.fun:.2f} after {found.nfev} evaluations (1 is the noise)")
print(f"E x {E:.3f} (truth 0.6), R_distal x {R:.3f} (truth 1.3)")

# %%
fig, axis = plt.subplots(figsize=(7.0, 3.2))
t = 4e-3 * np.arange(1, 26)
axis.plot(t, measured, "k.", label="measured")
axis.plot(t, curve(jnp.zeros(2)), label="before")
axis.plot(t, curve(jnp.asarray(found.x)), label="after")
axis.set(xlabel="time [s]", ylabel="outlet pressure [mmHg]")
axis.legend()
fig.tight_layout()
