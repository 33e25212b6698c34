"""What looks at a run while it goes on: writers of fields, averages over a cycle.

An observer may remember something between two looks. Its memory is part of every checkpoint, so
that a run that was ended goes on as if nothing had happened.
"""

import abc

import numpy as np

from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State

Memory = dict[str, np.ndarray]


class AbstractObserver(abc.ABC):
    """Looks at the state after whole steps."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """A name of its own among the observers of a run."""

    @property
    @abc.abstractmethod
    def every(self) -> int:
        """It looks whenever the number of whole steps is a multiple of this."""

    @abc.abstractmethod
    def observe(self, step: int, model: Model, state: State) -> None:
        """Look at the state after a whole step, or at the start of the run."""

    @abc.abstractmethod
    def memory(self) -> Memory:
        """What a checkpoint must keep: the same names, types and shapes throughout a run."""

    @abc.abstractmethod
    def restore(self, step: int, memory: Memory) -> None:
        """Go back to where it was at a checkpoint after a whole step."""
