"""One form of an effect on the layered bed: how its size is drawn, and what it does."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.foreign.layered_solver import LayeredForm

Size = dict[str, float]
"""Numbers that say how large an effect is, by name."""


class LayeredKind(NamedTuple):
    """A form of an effect.

    Attributes:
        effect: id of the effect, or "outside:KIND".
        form: name of the form.
        place: where it acts.
        draw: source of numbers → a size.
        build: a size → arguments of a `LayeredForm`.
        null: a size at which nothing happens.
        beats: least number of beats that a record of it needs.
    """

    effect: str
    form: str
    place: str
    draw: Callable[[np.random.Generator], Size]
    build: Callable[[Size], dict]
    null: Size
    beats: int = 1

    def make(self, size: Size) -> LayeredForm:
        """The effect in a given size."""
        return LayeredForm(
            effect=self.effect, form=self.form, size=size, place=self.place, **self.build(size)
        )
