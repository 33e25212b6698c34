"""The generators' priors as coordinates: a drawer of forms becomes a function of normal numbers.

A drawer takes numbers from a random generator. `Replay` stands in for it: every choice among a few
is a branch, which is enumerated with its probability, and every continuous number is a coordinate
z ~ N(0, 1), a uniform one through v = Φ(z). A drawer is then a sum over branches of smooth
functions of z (the primary sample space of Kelemen et al. 2002, Comput Graph Forum 21:531).
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterator

import numpy as np
from scipy.special import ndtr

from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.members import ForeignMember, parameters_of
from benchmarks.foreign.patient import ForeignPatient

Drawer = Callable[[np.random.Generator], EffectForm]

MOST_BRANCHES = 6
"""Choices among more are a coordinate."""

CELLS = 10
"""Values of `random()`: the drawers compare it with multiples of a tenth."""

LONGEST = 16
"""Longer arrays of normal numbers are a course over beats, see `Leaf.course`."""


class _Branch(Exception):
    """A choice that the branch at hand does not make yet."""


class Replay:
    """Stands in for a random generator.

    Attributes:
        choices: places chosen so far.
        z: coordinates, by which normal and uniform numbers come; zero beyond the last.
        course: what long arrays of normal numbers are filled from; zero beyond its shape.
        ranges: bounds of each coordinate that was taken, None for normal ones.
        cells: which choices are cells of `random()`.
        long: whether a long array was taken.
    """

    def __init__(self, choices: tuple[int, ...], z: np.ndarray, course: np.ndarray | None = None):
        self.choices, self.z, self.course = choices, z, course
        self.ranges: list[tuple[float, float] | None] = []
        self.cells: list[bool] = []
        self.long = False

    def _choose(self, count: int, cell: bool = False) -> int:
        if len(self.cells) == len(self.choices):
            raise _Branch(count)
        self.cells.append(cell)
        return self.choices[len(self.cells) - 1]

    def _next(self, bounds: tuple[float, float] | None) -> float:
        place = len(self.ranges)
        self.ranges.append(bounds)
        return float(self.z[place]) if place < len(self.z) else 0.0

    def random(self) -> float:
        """The middle of a cell."""
        return (self._choose(CELLS, cell=True) + 0.5) / CELLS

    def integers(self, low: int, high: int | None = None) -> int:
        """A whole number below `high`."""
        first, last = (0, low) if high is None else (low, high)
        if last - first <= MOST_BRANCHES:
            return first + self._choose(last - first)
        return min(int(self.uniform(first, last)), last - 1)

    def choice(self, values):
        """One of the values."""
        return values[self._choose(len(values))]

    def uniform(self, low: float = 0.0, high: float = 1.0) -> float:
        """A number between bounds."""
        low, high = float(low), float(high)
        return low + (high - low) * float(ndtr(self._next((low, high))))

    def normal(self, size=None):
        """Standard normal numbers."""
        if size is None:
            return self._next(None)
        if np.prod(size) > LONGEST:
            self.long = True
            found = np.zeros(size)
            if self.course is not None:
                rows, columns = self.course.shape
                found[:rows, :columns] = self.course
            return found
        return np.array([self._next(None) for _ in range(int(np.prod(size)))]).reshape(size)


@dataclasses.dataclass(frozen=True)
class Leaf:
    """A branch of a drawer.

    Attributes:
        drawer: of the effect.
        choices: that lead to the branch.
        log_share: logarithm of its probability.
        ranges: bounds of each coordinate, None for normal ones.
        used: which coordinates change the form.
        course: whether it has, besides, a normal number for every beat of every condition.
    """

    drawer: Drawer
    choices: tuple[int, ...]
    log_share: float
    ranges: tuple[tuple[float, float] | None, ...]
    used: np.ndarray
    course: bool

    def form(self, z: np.ndarray, course: np.ndarray | None = None) -> EffectForm:
        """The form at the used coordinates."""
        whole = np.zeros(len(self.ranges))
        whole[self.used] = z
        return self.drawer(Replay(self.choices, whole, course))  # pyright: ignore[reportArgumentType]


def leaves(drawer: Drawer, patient: ForeignPatient) -> list[Leaf]:
    """All branches of a drawer; cells of `random()` that give the same form are one."""
    found: dict[object, Leaf] = {}
    for choices, share, seen in _branches(drawer, (), 1.0):
        form = drawer(Replay(choices, np.zeros(0)))  # pyright: ignore[reportArgumentType]
        plain = tuple(c for c, cell in zip(choices, seen.cells, strict=True) if not cell)
        key = (plain, form.form, tuple(form.size.items()))
        if key in found:
            one = found[key]
            log_share = float(np.logaddexp(one.log_share, np.log(share)))
            found[key] = dataclasses.replace(one, log_share=log_share)
            continue
        used = _used(drawer, choices, len(seen.ranges), patient)
        found[key] = Leaf(
            drawer, choices, float(np.log(share)), tuple(seen.ranges), used, seen.long
        )
    return list(found.values())


def _branches(
    drawer: Drawer, choices: tuple[int, ...], share: float
) -> Iterator[tuple[tuple[int, ...], float, Replay]]:
    replay = Replay(choices, np.zeros(0))
    try:
        drawer(replay)  # pyright: ignore[reportArgumentType]
    except _Branch as branch:
        count = branch.args[0]
        for k in range(count):
            yield from _branches(drawer, (*choices, k), share / count)
        return
    yield choices, share, replay


def _used(
    drawer: Drawer, choices: tuple[int, ...], count: int, patient: ForeignPatient
) -> np.ndarray:
    """Places of the coordinates that change what the form does."""
    origin = _numbers(drawer(Replay(choices, np.zeros(count))), patient)  # pyright: ignore[reportArgumentType]
    found = []
    for k in range(count):
        z = np.zeros(count)
        z[k] = 0.7
        moved = _numbers(drawer(Replay(choices, z)), patient)  # pyright: ignore[reportArgumentType]
        if moved != origin:
            found.append(k)
    return np.array(found, int)


def _numbers(form: EffectForm, patient: ForeignPatient) -> list[float]:
    """All numbers by which a form acts: parameters, and what its functions close over."""
    found = [form.stated_shift]
    for c in patient.conditions:
        if not c.held_out:
            found += list(parameters_of(ForeignMember(patient, c, True), form).values())
    laws = [*form.physics, form.inlet, form.squeeze, form.sensors, form.flow, form.beats]
    for law in laws:
        found += _closed_over(law)
    return found


def _closed_over(value: object, depth: int = 4) -> list[float]:
    if isinstance(value, int | float | np.number):
        return [float(value)]
    if isinstance(value, np.ndarray):
        return value.ravel().tolist()
    if depth and callable(value):
        cells = [c.cell_contents for c in getattr(value, "__closure__", None) or ()]
        return list(itertools.chain.from_iterable(_closed_over(c, depth - 1) for c in cells))
    return []
