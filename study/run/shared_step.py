"""One compiled step for the ramp and for the runs after it.

A step is compiled for the classes of its ports. The ramp gives pressures where the runs have
boundary blocks; as `RampedPort` both are one program, and whether the ramp is on is a number.
"""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from jaxfsi.core.ports.port import AbstractPort, AbstractTractionPort
from jaxfsi.core.ports.ramped import RampedPort
from lumped import Ramp
from study.run.simulation_data import Setup


def ramped(
    ports: Mapping[str, AbstractTractionPort], pressures: Mapping[str, Ramp]
) -> dict[str, AbstractPort]:
    """The ports of a run under given pressures in place of their own conditions.

    Args:
        ports: of each opening.
        pressures: of each opening [dyn/cm²].
    """
    on = jnp.asarray(True)
    return {name: RampedPort(port, pressures[name], on) for name, port in ports.items()}


def with_ramp_off(setup: Setup) -> Setup:
    """A run with the ports that the ramp has, under their own conditions."""
    off = Ramp(0.0, 0.0), jnp.asarray(False)
    model = setup.model
    openings = setup.mesh.openings
    ports = tuple(
        RampedPort(port, *off)
        if name in openings and isinstance(port, AbstractTractionPort)
        else port
        for name, port in zip(model.names, model.ports, strict=True)
    )
    return dataclasses.replace(setup, model=eqx.tree_at(lambda m: m.ports, model, ports))
