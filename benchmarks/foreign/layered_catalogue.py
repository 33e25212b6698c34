"""All forms on the layered bed, by the name of the truth."""

from collections.abc import Callable

import numpy as np

from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.layered_kinds import LayeredKind
from benchmarks.foreign.layered_muscle import BED, DILATION
from benchmarks.foreign.layered_outside import OUTSIDE_KINDS
from benchmarks.foreign.layered_reading import READING
from benchmarks.foreign.layered_vessel import VESSEL

KINDS = (*VESSEL, *DILATION, *BED, *READING, *OUTSIDE_KINDS)
"""Every form of every effect."""

FAINT, FAINT_SHARE = 0.25, (0.1, 0.4)
"""Share of the records whose effect is faint, and what is left of its size."""

LAYERED_OUTSIDE = tuple(kind.effect.removeprefix("outside:") for kind in OUTSIDE_KINDS)
"""Causes outside the list that this generator has."""


def _drawer(kinds: list[LayeredKind]) -> Callable[[np.random.Generator], EffectForm]:
    def draw(rng: np.random.Generator) -> EffectForm:
        kind = kinds[int(rng.integers(len(kinds)))]
        size = kind.draw(rng)
        if rng.random() < FAINT:
            share = rng.uniform(*FAINT_SHARE)
            size = {key: x + share * (size[key] - x) for key, x in kind.null.items()}
        return kind.make(size)

    return draw


LAYERED_DRAWERS: dict[str, Callable[[np.random.Generator], EffectForm]] = {
    "none": lambda rng: EffectForm(),
    **{
        name: _drawer([kind for kind in KINDS if kind.effect == name])
        for name in dict.fromkeys(kind.effect for kind in KINDS)
    },
}
"""A function for each truth that draws a form and a size."""
