"""Where the time of a command went: its longest steps as parts of one bar."""

from collections.abc import Mapping
from typing import NamedTuple

LONGEST = 6
"""Steps with a part of their own."""

_COLOURS = ("#1f6fb2", "#d9822b", "#5a8f3c", "#8a5fa8", "#3a9c9c", "#b3382c")
_REST_COLOUR = "#b9c0c8"


class TimePart(NamedTuple):
    """A part of the bar.

    Attributes:
        name: of the step.
        seconds: that it took.
        percent: of the whole.
        colour: of the part.
    """

    name: str
    seconds: float
    percent: float
    colour: str


def time_parts(seconds: Mapping[str, float]) -> list[TimePart]:
    """The longest steps in the order in which they ran, and the rest.

    Args:
        seconds: that each step took, by name.
    """
    whole = sum(seconds.values())
    if whole <= 0.0:
        return []
    longest = sorted(seconds, key=lambda name: -seconds[name])[:LONGEST]
    chosen = {name: seconds[name] for name in seconds if name in longest}
    parts = [
        TimePart(name, taken, 100.0 * taken / whole, colour)
        for (name, taken), colour in zip(chosen.items(), _COLOURS, strict=False)
    ]
    rest = whole - sum(chosen.values())
    if len(chosen) < len(seconds):
        parts.append(TimePart("all other steps", rest, 100.0 * rest / whole, _REST_COLOUR))
    return parts
