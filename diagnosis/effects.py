"""Effects: one-parameter extensions of the circuit, each with its meaning for the reader.

A new effect takes ten lines and no other change::

    leak = Effect(
        id="leak",
        place="wall",
        unit="cm5/(dyn s)",
        sd=1.5e-6,
        one_sided=True,
        equation="Q = G (P_inlet − P_2)",
        change=lambda c, size: c._replace(G_collateral=c.G_collateral + size),
        sentence="blood leaks past the ostium",
        settled_by="an occlusion pressure",
        source="assumed",
    )
    diagnose(records, effects=(*CATALOGUE, leak))

A cause whose equation is not settled has further forms: other equations of the same effect, which
share its prior evenly. Its evidence is the mean over its forms, so that a record which follows
another form than the first still counts for the cause.

The prior of the size φ has two parts. The first vanishes at zero, where an effect explains nothing
(moment prior: Johnson & Rossell 2010, J R Stat Soc B 72:143); the second, with the weight
w = `NEAR_ZERO`, does not, since effects too weak to be seen exist:

    p(φ) = ((1 − w) φ²/s² + w) N(φ; 0, s²),    s = sd/√3,

sd being the root mean square of the first. A one-sided effect has the positive half. Fits use
N(0, s²); evidences have the factor (1 − w) E[φ²]/s² + w.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from diagnosis.changes import Change, changed
from diagnosis.circuit import Circuit

Place = Literal["ostium", "wall", "microvasculature", "pump", "inlet", "sensor"]
PLACES: tuple[Place, ...] = ("ostium", "wall", "microvasculature", "pump", "inlet", "sensor")
"""Places where an effect may act, from the ostium to the instruments."""

GUESSED_FORM = 0.15
"""Relative uncertainty of an effect's waveform whose equation is a guess."""

CRUDE_FORM = 0.3
"""The same if the equation stands for a whole family of shapes."""

SCALE = 3.0**-0.5
"""Width s of the prior over its root mean square."""

NEAR_ZERO = 0.3
"""Weight of the part of the prior that does not vanish at zero. Without it "no gap" was stated with
0.7 where it held in 0.4 of the records of other hands, whose sizes reach down to nothing."""

EXPECTED = 1.0 / SCALE
"""Standardised size of an effect at that root mean square."""

NEGATIVE_LIMIT = 0.1
"""How far below zero a one-sided size may go in a fit, in units of the prior's width."""


class Form(NamedTuple):
    """Another equation of an effect, with the same size, place and prior.

    Attributes:
        name: of the form.
        equation: the equation that it adds or changes, in one line.
        change: the circuit with this form at a size, see `Effect`.
        nonlinear: whether the ostium becomes nonlinear though it does not in the effect's first
            form.
    """

    name: str
    equation: str
    change: Change
    nonlinear: bool = False


class Effect(NamedTuple):
    """One candidate cause of a gap.

    Attributes:
        id: its name in records and results.
        place: where it acts.
        unit: clinical unit of its size.
        sd: root mean square of the size a priori [unit].
        change: the circuit, which is in CGS, with this effect at a size in its unit: a function,
            or one of `changes`; size 0 must change nothing.
        equation: the equation that it adds or changes, in one line.
        sentence: plain-language meaning, beginning in lower case.
        settled_by: the measurement that would confirm or exclude it.
        source: origin of the equation and of the range of sizes.
        one_sided: set it if a negative size has no physical meaning (a loss, a lag, a conductance);
            not if the assumed value may be wrong in both directions.
        tolerance: relative uncertainty of the waveform: 0 if the equation is a law, or scales or
            shifts a parameter or trace that is there already; `GUESSED_FORM` if it is one of
            several plausible equations; `CRUDE_FORM` if one number stands for a family of shapes.
        nonlinear: set it if the drop of the ostium becomes nonlinear in the flow or varies in time:
            the linear solution ignores `K`, `K_known`, `K_turbulent` and `R0_wave`. A test compares
            the two.
        two_starts: set it if the data hardly change at small sizes, or other unknowns imitate them,
            so that a fit from zero may stay there although a size near `sd` fits better. Fits then
            start at one `sd` as well, which costs one more fit a record and two more of pairs.
        ridge: set it if, of means and ratios alone, a large size with little flow looks like a
            small size with much flow. The evidence without waveforms is then an integral over the
            size (`ridge`), at seven fits a record; one-sided effects only. Compare ln B with
            `benchmarks.blind.sample` to see whether it is needed.
        forms: further forms, see above.
        form: name of the form that `change` is; empty for the first.
    """

    id: str
    place: Place
    unit: str
    sd: float
    change: Change
    equation: str
    sentence: str
    settled_by: str
    source: str
    one_sided: bool = False
    tolerance: float = 0.0
    nonlinear: bool = False
    two_starts: bool = False
    ridge: bool = False
    forms: tuple[Form, ...] = ()
    form: str = ""


def apply_effects(
    circuit: Circuit, effects: Sequence[Effect], sizes: Float[Array, " e"]
) -> Circuit:
    """The circuit with every effect at its size.

    Args:
        circuit: one condition.
        effects: the effects, in the order of the sizes.
        sizes: size of each [its unit]; zero changes nothing.
    """
    return changed(circuit, [effect.change for effect in effects], sizes)


def bounded_size(scale: Array, one_sided: Array, x: Array) -> Array:
    """Size of an effect at a standardised variable x (the prior's width is one).

    Below zero a one-sided size levels off smoothly at −`NEGATIVE_LIMIT`. Fits may go there; the
    evidence counts only the positive half of the posterior.
    """
    below = NEGATIVE_LIMIT * jnp.expm1(jnp.minimum(x, 0.0) / NEGATIVE_LIMIT)
    bounded = jnp.where(x < 0.0, below, x)
    return scale * jnp.where(one_sided, bounded, x)


def all_forms(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Every form of every effect as an effect of its own, under the same id."""
    found: list[Effect] = []
    for effect in effects:
        found.append(effect._replace(forms=()))
        found += [
            effect._replace(
                change=f.change,
                equation=f.equation,
                form=f.name,
                nonlinear=effect.nonlinear or f.nonlinear,
                forms=(),
            )
            for f in effect.forms
        ]
    return tuple(found)


def find_effect(effects: Sequence[Effect], id: str) -> Effect:
    """The effect of that name.

    Raises:
        ValueError: there is none.
    """
    for effect in effects:
        if effect.id == id:
            return effect
    raise ValueError(f"No effect '{id}'. There are: {', '.join(e.id for e in effects)}.")
