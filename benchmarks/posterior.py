"""Three ways to the same posterior of FFR: samples weighed by evidence, NUTS, and Laplace's form.

Patients of `benchmarks.independent_patients` with a measured flow reserve. All three have the same
model (FFR by means, corrected by periodic states), the same distributions of the inputs and the
same evidence:

- draws weighed by the evidence and drawn again (`calibration.uncertainty`), what the pages show;
- the No-U-Turn sampler of blackjax in the standard normal numbers of the inputs, the reference,
  which like Laplace leaves out the small error of the correction;
- Laplace: a normal distribution at the mode, with the curvature there, FFR to first order.

Source: Hoffman & Gelman 2014, JMLR 15:1593; Tierney & Kadane 1986, JASA 81:82.
"""

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float
from scipy.stats import norm

from benchmarks.coverage import REST_RATIO_ERROR, SEED, patient_model
from benchmarks.independent_patients import patients
from calibration import (
    AbstractSpread,
    Correction,
    Evidence,
    MeasurementErrors,
    correction,
    evaluate,
    patient_inputs,
    stress_evidence,
    uncertainty,
)
from lumped.nominal import RESERVE_ERROR
from study.run.ratio_uncertainty import N_RUNS

N_PATIENTS = 20
N_SAMPLES = 2**15
WARMUP, CHAINS, DRAWS = 500, 8, 2000
LEVELS = (0.05, 0.5, 0.95)
AGREES = 0.005
"""Difference of a quantile of FFR that a page may have."""


class InputDensity(eqx.Module):
    """Density of the inputs of a patient, as standard normal numbers, after the evidence.

    Attributes:
        quick: FFR by means.
        learned: what periodic states add to it.
        predicted: flow reserve from the inputs and FFR.
        spreads: distributions of the inputs.
        names: their names (static).
        value: measured flow reserve [-].
        sd: its standard deviation [-].
    """

    quick: Any
    learned: Correction
    predicted: Any
    spreads: tuple[AbstractSpread, ...]
    value: Array
    sd: Array
    names: tuple[str, ...] = eqx.field(static=True)

    def ffr(self, z: Float[Array, " inputs"]) -> Float[Array, ""]:
        """FFR at standard normal numbers [-]."""
        return self.learned(z, self.quick(self._values(z)))

    def log_density(self, z: Float[Array, " inputs"]) -> Float[Array, ""]:
        """Logarithm of the density, up to a constant."""
        missed = (self.predicted(self._values(z), self.ffr(z)) - self.value) / self.sd
        return -0.5 * (jnp.sum(z**2) + missed**2)

    def _values(self, z: Float[Array, " inputs"]) -> dict[str, Array]:
        return {n: s.value(v) for n, s, v in zip(self.names, self.spreads, z, strict=True)}


class Found(NamedTuple):
    """Quantiles of FFR by one way, and the seconds it took."""

    quantiles: np.ndarray
    seconds: float


def run(rounds: int = 1) -> dict[str, Any]:
    """Compare the three ways.

    Args:
        rounds: not used: nothing is timed twice.

    Returns:
        {"name", "rows", "notes", "passed"}, ready for JSON.
    """
    del rounds
    measured = [p for p in patients(10 * N_PATIENTS, SEED) if p["measured"]["cfr"] is not None]
    rows = [_row(k, patient) for k, patient in enumerate(measured[:N_PATIENTS], start=1)]
    worst = {way: max(row[f"{way}_off"] for row in rows) for way in ("weighed", "laplace")}
    return {
        "name": "posterior",
        "rows": rows,
        "notes": [
            "off: largest difference of the 5 %, 50 % and 95 % quantile of FFR from that of NUTS.",
            f"Largest of all patients: weighed draws {worst['weighed']:.4f}, Laplace"
            f" {worst['laplace']:.4f}; pages show weighed draws, which may differ by {AGREES}.",
            f"NUTS: {CHAINS} chains of {DRAWS} after {WARMUP} steps of warm-up. Seconds include"
            " compilation for the first patient alone.",
        ],
        "passed": worst["weighed"] <= AGREES,
    }


def _row(number: int, patient: Mapping[str, Any]) -> dict[str, Any]:
    model = patient_model(patient)
    inputs = patient_inputs(
        model,
        stress_evidence(patient["drug"], patient["age_group"]),
        MeasurementErrors(rest_ratio=REST_RATIO_ERROR),
    )
    medians = {name: spread.value(jnp.zeros(())) for name, spread in inputs.items()}
    form = model.with_values(medians).form_factors
    quick = eqx.Partial(model.ffr_of_means, form=form)
    runs = evaluate(model.ffr, quick, inputs, N_RUNS)
    # arrays for plain numbers, so that one compilation serves all patients
    learned = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), correction(runs))
    reserve = patient["measured"]["cfr"]
    sd = RESERVE_ERROR * reserve
    posterior = InputDensity(
        quick,
        learned,
        model.reserve,
        tuple(inputs.values()),
        jnp.asarray(reserve),
        jnp.asarray(sd),
        tuple(inputs),
    )
    start = time.perf_counter()
    evidence = [Evidence(model.reserve, reserve, sd)]
    weighed = uncertainty(
        posterior.quick, inputs, evidence=evidence, runs=[runs], n_samples=N_SAMPLES
    )
    ways = {
        "weighed": Found(np.quantile(weighed.samples, LEVELS), time.perf_counter() - start),
        "nuts": _nuts(posterior, number),
        "laplace": _laplace(posterior),
    }
    row: dict[str, Any] = {
        "patient": number,
        "drug": patient["drug"],
        "side": patient["side"],
        "n_effective": round(weighed.n_effective),
    }
    for way, found in ways.items():
        row[way] = ", ".join(f"{q:.4f}" for q in found.quantiles)
        if way != "nuts":
            row[f"{way}_off"] = float(np.max(np.abs(found.quantiles - ways["nuts"].quantiles)))
        row[f"{way}_s"] = found.seconds
    return row


def _nuts(posterior: InputDensity, seed: int) -> Found:
    start = time.perf_counter()
    keys = jax.random.split(jax.random.key(seed), CHAINS)
    draws = np.asarray(_chains(posterior, keys)).ravel()
    return Found(np.quantile(draws, LEVELS), time.perf_counter() - start)


@eqx.filter_jit
def _chains(posterior: InputDensity, keys: Array) -> Float[Array, "chains draws"]:
    """FFR along chains that start from the prior."""
    try:
        import blackjax  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ImportError(
            "blackjax is not installed, which draws the chains. Try: pip install "
            "'jaxfsi[benchmark]'"
        ) from error
    n = len(posterior.names)

    def chain(key: Array) -> Float[Array, " draws"]:
        of_start, of_warmup, of_draws = jax.random.split(key, 3)
        warmup: Any = blackjax.window_adaptation(blackjax.nuts, posterior.log_density)
        (state, parameters), _ = warmup.run(
            of_warmup, 0.3 * jax.random.normal(of_start, (n,)), WARMUP
        )
        kernel = blackjax.nuts(posterior.log_density, **parameters)

        def draw(state: Any, key: Array) -> tuple[Any, Array]:
            state, _ = kernel.step(key, state)
            return state, posterior.ffr(state.position)

        return jax.lax.scan(draw, state, jax.random.split(of_draws, DRAWS))[1]

    return jax.lax.map(chain, keys)


def _laplace(posterior: InputDensity) -> Found:
    start = time.perf_counter()
    middle, sd = (float(v) for v in _at_mode(posterior))
    return Found(middle + sd * norm.ppf(LEVELS), time.perf_counter() - start)


@eqx.filter_jit
def _at_mode(posterior: InputDensity) -> tuple[Array, Array]:
    """FFR at the mode, and its standard deviation to first order."""

    def cost(z: Array, model: InputDensity) -> Array:
        return -model.log_density(z)

    zero = jnp.zeros(len(posterior.names))
    mode = optx.minimise(cost, optx.BFGS(rtol=1e-8, atol=1e-8), zero, posterior).value
    curvature = jax.hessian(cost)(mode, posterior)
    slope = jax.grad(posterior.ffr)(mode)
    return posterior.ffr(mode), jnp.sqrt(slope @ jnp.linalg.solve(curvature, slope))
