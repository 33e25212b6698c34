"""Length of the steps: halves of halves of the longest one.

A step of level L is dt/2^L long. A step that fails is repeated one level deeper, then reported
where it fails at the deepest one. After a number of good steps the level falls again, at instants
that the longer step reaches too: the end of every whole step dt is met exactly, whatever failed.

Adaptive steps work on the same ladder. With the change c of a step (`jaxfsi.simulation.chunk`),
which grows with dt², the level rises where c > change_limit and falls where all recent steps had
c < change_limit/10: twice the step has four times the change, and a step of another length stirs
the fields a little.
"""

import dataclasses
from typing import NamedTuple

from jaxfsi.nominal import MAX_HALVINGS

_MARGIN = 10.0


@dataclasses.dataclass(frozen=True)
class StepControl:
    """How the length of steps is chosen.

    Attributes:
        max_halvings: deepest level.
        good_steps: steps of a level without trouble before longer ones are tried; even.
        change_limit: largest change of a step; None takes steps of equal length. 0.03 resolves the
            start of ejection; 0.1 is rough.
    """

    max_halvings: int = MAX_HALVINGS
    good_steps: int = 8
    change_limit: float | None = None

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            ValueError: a number is out of range.
        """
        if not 0 <= self.max_halvings <= 12:
            raise ValueError(
                f"max_halvings = {self.max_halvings} is not between 0 and 12. 4 is usual."
            )
        if self.good_steps < 2 or self.good_steps % 2:
            raise ValueError(
                f"good_steps = {self.good_steps} is no even number from 2 on. 8 is usual."
            )
        if self.change_limit is not None and not self.change_limit > 0.0:
            raise ValueError(
                f"change_limit = {self.change_limit} is not positive. Try 0.03, or None for equal"
                " steps."
            )


class Position(NamedTuple):
    """Where a run is.

    Attributes:
        tick: time passed, in steps of the deepest level.
        level: level of the next step.
        calm: good steps since the level last changed.
    """

    tick: int = 0
    level: int = 0
    calm: int = 0


def stride(level: int, control: StepControl) -> int:
    """Ticks in a step of a level."""
    return 2 ** (control.max_halvings - level)


def whole_steps(position: Position, control: StepControl) -> float:
    """Time passed, in steps of full length."""
    return position.tick / stride(0, control)


def steps_to(stop: int, position: Position, control: StepControl) -> int:
    """Steps to take before looking again.

    Args:
        stop: number of the whole step to reach.
        position: where the run is.
        control: see `StepControl`.
    """
    unit = stride(position.level, control)
    left = (stop * stride(0, control) - position.tick) // unit
    if position.level == 0:
        return left
    odd = (position.tick // unit) % 2
    return min(left, max(control.good_steps - position.calm, 2) + odd)


def after_steps(
    n_good: int, trouble: bool, largest_change: float, position: Position, control: StepControl
) -> Position:
    """Where the run is after some steps, and the level of the next one.

    Args:
        n_good: steps that succeeded.
        trouble: whether the next step failed, or the last one was too coarse.
        largest_change: of the good steps.
        position: where the run was.
        control: see `StepControl`.
    """
    unit = stride(position.level, control)
    tick = position.tick + n_good * unit
    if trouble:
        return Position(tick, min(position.level + 1, control.max_halvings), 0)
    calm = position.calm + n_good
    limit = control.change_limit
    if limit is not None and largest_change > limit / _MARGIN:
        return Position(tick, position.level, 0)
    reached = position.level > 0 and tick % (2 * unit) == 0
    if reached and calm >= control.good_steps:
        return Position(tick, position.level - 1, 0)
    return Position(tick, position.level, calm)
