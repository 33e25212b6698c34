"""Runs of many steps: repeats, adaptive steps, records, checkpoints, fields and averages."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from jaxfsi.simulation.checkpoint import (
        Checkpoint,
        CheckpointError,
        fingerprint,
        load_checkpoint,
        save_checkpoint,
    )
    from jaxfsi.simulation.chunk import Chunk, advance_chunk
    from jaxfsi.simulation.collapse import COLLAPSED, Collapse, collapse
    from jaxfsi.simulation.field_series import FieldSeries
    from jaxfsi.simulation.observer import AbstractObserver
    from jaxfsi.simulation.record import StepHistory, mean_over, write_csv
    from jaxfsi.simulation.shear_cycle import ShearCycle, ShearMeans
    from jaxfsi.simulation.simulation import (
        ProgressRecord,
        Simulation,
        SimulationError,
        SimulationInterrupted,
        SolverChoice,
        simulate,
    )
    from jaxfsi.simulation.step_control import StepControl

__all__ = [
    "COLLAPSED",
    "AbstractObserver",
    "Checkpoint",
    "CheckpointError",
    "Chunk",
    "Collapse",
    "FieldSeries",
    "ProgressRecord",
    "ShearCycle",
    "ShearMeans",
    "Simulation",
    "SimulationError",
    "SimulationInterrupted",
    "SolverChoice",
    "StepControl",
    "StepHistory",
    "advance_chunk",
    "collapse",
    "fingerprint",
    "load_checkpoint",
    "mean_over",
    "save_checkpoint",
    "simulate",
    "write_csv",
]

import_on_first_use(__name__)
