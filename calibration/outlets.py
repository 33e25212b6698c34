"""Blocks behind the outlets of a 3D model, and their initial states.

**Shares.** Where an artery ends in several outlets, outlet i has the share

    s_i = r_i^2.6 / Σ_j r_j^2.6

of its bed: the resistances over s_i, the compliances times s_i, so that the outlets together are
the bed. The exponent is that of coronary arteries.

**Aorta.** In series with the Windkessel stands the characteristic impedance of the aorta, which
sends no wave back, at most half of the total resistance. It stays as it is under stress.

**Start.** Each block starts from the periodic state that it has in 0D behind the aortic pressure,
or behind the surrogate of its artery.

Sources: Changizi and Cherniak 2000 (Can J Physiol Pharmacol 78:603); Puelz et al. 2024,
section 2.3.
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.systemic import characteristic_impedance
from lumped import (
    RCR,
    AbstractElement,
    Coronary,
    PressureSource,
    Propagator,
    Shooting,
    StressRule,
    VentricularPressure,
    connect,
    scale_resistances,
    solve_periodic,
)
from lumped.network import Network
from lumped.parameters import Parameter
from lumped.stress import scaled
from lumped.waveforms import AbstractWaveform

_EXPONENT = 2.6


def outlet_shares(areas: Mapping[str, float]) -> dict[str, float]:
    """Share of each outlet of one artery in its flow; they add up to 1.

    Args:
        areas: area of each outlet [cm²].
    """
    weight = {name: area ** (_EXPONENT / 2.0) for name, area in areas.items()}
    total = sum(weight.values())
    return {name: own / total for name, own in weight.items()}


def share_of(bed: Coronary, share: Parameter) -> Coronary:
    """The part of a bed that carries a share of its flow at the same pressures."""
    if isinstance(share, float) and share == 1.0:
        return bed
    return scaled(scale_resistances(bed, 1.0 / share), C_a=share, C_im=share)


def coronary_outlet(
    bed: Coronary, ventricle: VentricularPressure, scale: Parameter, rule: StressRule | None
) -> Coronary:
    """A coronary bed in a condition.

    Args:
        bed: at rest, with the pressure of the ventricle.
        ventricle: pressure of the ventricle in the condition.
        scale: of its resistances, α [-].
        rule: stress rule; None at rest.
    """
    bed = scale_resistances(bed, scale)
    return bed if rule is None else eqx.tree_at(lambda b: b.P_im, rule(bed), ventricle)


def with_impedance(
    block: RCR,
    area: Parameter,
    rho: Parameter,
    E: Parameter,
    nu: Parameter,
    thickness_per_radius: Parameter,
) -> RCR:
    """A Windkessel with the aortic impedance as proximal resistance and unchanged total resistance.

    Args:
        block: the Windkessel; its distal resistance is the whole one, its proximal one is replaced.
        area: of the outlet [cm²].
        rho: density of the blood [g/cm³].
        E: Young's modulus of the wall [dyn/cm²].
        nu: Poisson's ratio [-].
        thickness_per_radius: wall thickness over lumen radius [-].
    """
    total = block.R_distal
    series = characteristic_impedance(area, rho, E, nu, thickness_per_radius)
    series = jnp.minimum(series, 0.5 * total)
    return RCR(R_proximal=series, C=block.C, R_distal=total - series, P_ref=block.P_ref)


def periodic_start(
    inlet: AbstractWaveform, period: float, block: AbstractElement
) -> Float[Array, " states"]:
    """Periodic states of a block directly behind the aortic pressure, at the start of a cycle.

    Args:
        inlet: aortic pressure [dyn/cm²].
        period: length of a cycle [s].
        block: the block.

    Raises:
        RuntimeError: no periodic state was found.
    """
    parts: dict[str, Any] = {
        "inlet": (PressureSource(inlet), "aorta"),
        "coronary": (block, "aorta"),
    }
    return network_start(connect(parts), period)


def network_start(network: Network, period: Parameter) -> Float[Array, " states"]:
    """Periodic states of the element `coronary` of a network, at the start of a cycle.

    Raises:
        RuntimeError: no periodic state was found.
    """
    solver = Propagator() if network.is_linear else Shooting()
    solution = solve_periodic(network, period, solver)
    names = network["coronary"].state_names
    return jnp.array([solution.state("coronary", name)[0] for name in names], float)
