"""Finite elements of blood and wall on tetrahedra, and the coupled step in time.

A run in four lines: `build_model` from a mesh and its ports, `initial_state`, `prepare`, `march`.
"""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from jaxfsi.core.laws.contact import LeastGap
    from jaxfsi.core.laws.fibres import HolzapfelGasserOgden
    from jaxfsi.core.laws.fluid import Blood
    from jaxfsi.core.laws.materials import (
        AbstractMaterial,
        LinearElastic,
        NeoHookean,
        SaintVenantKirchhoff,
    )
    from jaxfsi.core.laws.solid import Wall
    from jaxfsi.core.laws.viscosity import AbstractViscosity, CarreauYasuda, Newtonian
    from jaxfsi.core.ports.block import BlockPort
    from jaxfsi.core.ports.flow import FlowPort
    from jaxfsi.core.ports.inertance import ResistanceInertancePort
    from jaxfsi.core.ports.plug import PlugPort
    from jaxfsi.core.ports.port import AbstractPort, AbstractTractionPort, AbstractVelocityPort
    from jaxfsi.core.ports.pressure import PressurePort
    from jaxfsi.core.ports.ramped import RampedPort
    from jaxfsi.core.ports.velocity import AbstractVelocity, VelocityPort
    from jaxfsi.core.statics.equilibrium import Equilibrium, equilibrium, static_factor
    from jaxfsi.core.statics.loads import Loads, PressureLoad, pressure_load
    from jaxfsi.core.statics.prestress import Prestress, prestressed
    from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha, generalized_alpha
    from jaxfsi.core.step.march import March, march
    from jaxfsi.core.step.model import Model, build_model
    from jaxfsi.core.step.state import State, initial_state
    from jaxfsi.core.step.step import RESULTS, advance_step
    from jaxfsi.core.step.stepper import Stepper, prepare

__all__ = [
    "RESULTS",
    "AbstractMaterial",
    "AbstractPort",
    "AbstractTractionPort",
    "AbstractVelocity",
    "AbstractVelocityPort",
    "AbstractViscosity",
    "BlockPort",
    "Blood",
    "CarreauYasuda",
    "Equilibrium",
    "FlowPort",
    "GeneralizedAlpha",
    "HolzapfelGasserOgden",
    "LeastGap",
    "LinearElastic",
    "Loads",
    "March",
    "Model",
    "NeoHookean",
    "Newtonian",
    "PlugPort",
    "PressureLoad",
    "PressurePort",
    "Prestress",
    "RampedPort",
    "ResistanceInertancePort",
    "SaintVenantKirchhoff",
    "State",
    "Stepper",
    "VelocityPort",
    "Wall",
    "advance_step",
    "build_model",
    "equilibrium",
    "generalized_alpha",
    "initial_state",
    "march",
    "prepare",
    "pressure_load",
    "prestressed",
    "static_factor",
]

import_on_first_use(__name__)
