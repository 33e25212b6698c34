"""All forms of the own circuit, by the name of the truth."""

from collections.abc import Callable

import numpy as np

from benchmarks.foreign import bed, ostium, outside, sensing
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.schedule import EFFECTS


def _drawer(name: str) -> Callable[[np.random.Generator], EffectForm]:
    for room in (ostium, bed, sensing):
        if hasattr(room, name):
            return getattr(room, name)
    raise KeyError(name)


DRAWERS: dict[str, Callable[[np.random.Generator], EffectForm]] = {
    "none": lambda rng: EffectForm(),
    **{name: _drawer(name) for name in EFFECTS},
    **{f"outside:{name}": drawer for name, drawer in outside.KINDS.items()},
}
"""A function for each truth that draws a form and a size."""
