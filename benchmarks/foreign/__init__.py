"""Blind records from generators that share nothing with the diagnosis.

Four generators draw measured records whose cause is known and withheld. Their circuits, their
integrators and the forms of their effects are written from one line of words an effect and from
the literature, without a look at the forms that the diagnosis fits.

- `zerod`: svZeroDSolver's blocks and its own time integrator.
- `other_forms`: an own circuit with several forms of every effect, one drawn at random.
- `real_clock`: the same circuit behind a real acquisition: irregular beats, respiration, ectopic
  beats, aortic pressures of another family, a clock that does not know the beats.
- `layered`: an own bed of three muscle layers whose resistances depend on their volume, so that
  even without an effect the truth is not the base model's single compartment.

`python -m benchmarks.foreign make OUT --generator NAME --records 150 --seed S` writes them.
"""

from benchmarks.foreign.record import ForeignRecord
from benchmarks.foreign.schedule import EFFECTS, OUTSIDE

GENERATORS = ("zerod", "other_forms", "real_clock", "layered")
"""Modules of this package that have `draw(seed, number)`."""
