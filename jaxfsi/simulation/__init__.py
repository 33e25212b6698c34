"""Runs of many steps: repeats, adaptive steps, records, checkpoints, fields and averages."""

from jaxfsi.simulation.checkpoint import (
    Checkpoint,
    CheckpointError,
    fingerprint,
    load_checkpoint,
    save_checkpoint,
)
from jaxfsi.simulation.chunk import Chunk, advance_chunk
from jaxfsi.simulation.field_series import FieldSeries
from jaxfsi.simulation.observer import AbstractObserver
from jaxfsi.simulation.record import Record, mean_over, write_csv
from jaxfsi.simulation.shear_cycle import ShearCycle, ShearMeans
from jaxfsi.simulation.simulation import (
    Glimpse,
    Simulation,
    SimulationError,
    SimulationInterrupted,
    SolverChoice,
    simulate,
)
from jaxfsi.simulation.step_control import StepControl
