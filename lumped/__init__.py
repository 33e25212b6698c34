"""Lumped (0D) haemodynamics: waveforms, boundary blocks, networks and their periodic states.

Importing this package switches JAX to double precision: the figures promised here (means to
1e-12, periodic waveforms to 1e-8) do not exist in single precision.
"""

import os
import sys
from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

os.environ["JAX_ENABLE_X64"] = "1"  # JAX reads it when it is imported
if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)

if TYPE_CHECKING:
    from lumped.blocks import RC, RCR, RCRL, Coronary, Resistance
    from lumped.elements import AbstractElement
    from lumped.extended_coronary import ExtendedCoronary
    from lumped.march import Trajectory, aligned_times, march, step
    from lumped.metrics import Metrics, ifr, metrics, pressure_ratio, systolic_share
    from lumped.network import Network, connect
    from lumped.periodic import solve_periodic
    from lumped.periodic_linear import Fourier, Propagator
    from lumped.periodic_nonlinear import Cycles, Shooting
    from lumped.periodic_solution import (
        AbstractPeriodicSolver,
        PeriodicSolution,
        averaged,
        mean_state,
        steady_state,
        waveform_mean,
    )
    from lumped.results import RESULTS, raise_unless_successful
    from lumped.sources import FlowSource, PressureSource
    from lumped.statespace import StateSpace, algebraic, field, is_index_one, state_space
    from lumped.stress import StressRule, scale_resistances, scaled, stress_rule, transition
    from lumped.surrogate import (
        HaemodynamicCondition,
        Surrogate,
        condition_from_clinic,
        ffr_divider,
        nominal_coronary,
    )
    from lumped.svzerod import SvZeroDCase, SvZeroDOutput, periodic_case, simulate_case
    from lumped.svzerod_reader import read_svzerod
    from lumped.svzerod_writer import svzerod_config, write_svzerod
    from lumped.units import L_PER_MIN, ML_PER_MIN, MM, MMHG, MMHG_S_PER_ML
    from lumped.vessels import Vessel, VesselCRL
    from lumped.views import (
        advance,
        block_field,
        direct_current,
        driven,
        implicit_step,
        transfer_impedance,
    )
    from lumped.waveforms import (
        AbstractWaveform,
        AorticPressure,
        Constant,
        Ramp,
        Sampled,
        Sinusoid,
        Stretched,
        VentricularPressure,
        sampled,
    )

__all__ = [
    "L_PER_MIN",
    "ML_PER_MIN",
    "MM",
    "MMHG",
    "MMHG_S_PER_ML",
    "RC",
    "RCR",
    "RCRL",
    "RESULTS",
    "AbstractElement",
    "AbstractPeriodicSolver",
    "AbstractWaveform",
    "AorticPressure",
    "Constant",
    "Coronary",
    "Cycles",
    "ExtendedCoronary",
    "FlowSource",
    "Fourier",
    "HaemodynamicCondition",
    "Metrics",
    "Network",
    "PeriodicSolution",
    "PressureSource",
    "Propagator",
    "Ramp",
    "Resistance",
    "Sampled",
    "Shooting",
    "Sinusoid",
    "StateSpace",
    "StressRule",
    "Stretched",
    "Surrogate",
    "SvZeroDCase",
    "SvZeroDOutput",
    "Trajectory",
    "VentricularPressure",
    "Vessel",
    "VesselCRL",
    "advance",
    "algebraic",
    "aligned_times",
    "averaged",
    "block_field",
    "condition_from_clinic",
    "connect",
    "direct_current",
    "driven",
    "ffr_divider",
    "field",
    "ifr",
    "implicit_step",
    "is_index_one",
    "march",
    "mean_state",
    "metrics",
    "nominal_coronary",
    "periodic_case",
    "pressure_ratio",
    "raise_unless_successful",
    "read_svzerod",
    "sampled",
    "scale_resistances",
    "scaled",
    "simulate_case",
    "solve_periodic",
    "state_space",
    "steady_state",
    "step",
    "stress_rule",
    "svzerod_config",
    "systolic_share",
    "transfer_impedance",
    "transition",
    "waveform_mean",
    "write_svzerod",
]

import_on_first_use(__name__)
