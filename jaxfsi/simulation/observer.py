"""Observers of a run in progress: writers of fields, averages over a cycle.

The state of an observer is part of every checkpoint, so that an interrupted run continues to the
same result.
"""

import abc

import numpy as np

from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State

ObserverState = dict[str, np.ndarray]


class AbstractObserver(abc.ABC):
    """Observes the state after whole steps."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """Name, unique among the observers of a run."""

    @property
    @abc.abstractmethod
    def every(self) -> int:
        """Whole steps between two observations."""

    @abc.abstractmethod
    def observe(self, step: int, model: Model, state: State) -> None:
        """Observe the state after a whole step, or at the start of the run."""

    @abc.abstractmethod
    def saved_state(self) -> ObserverState:
        """State for checkpoints: the same names, types and shapes throughout a run."""

    @abc.abstractmethod
    def restore(self, step: int, saved_state: ObserverState) -> None:
        """Restore the state of a checkpoint after a whole step."""
