"""Result codes that pass through jit and vmap, and their messages.

The codes are those of optimistix and three more. Failed results hold NaN, so that an unchecked
failure is not mistaken for an answer.
"""

from typing import Any

import jax
import numpy as np
import optimistix as optx

from lumped.parameters import is_traced

_OWN = {
    "outside_range": (
        "a parameter is not finite or lies outside its range: resistances, compliances, periods "
        "and pressures must be positive, the systolic pressure above the diastolic one."
    ),
    "infeasible": (
        "no scale factor reaches the ratio: it must lie below 1, above the venous over the mean "
        "aortic pressure, and the artery must have a resistance."
    ),
    "undetermined": (
        "the data do not determine the parameters, or what they give no artery has (a resistance "
        "below zero)."
    ),
}


class RESULTS(optx.RESULTS):  # pyright: ignore[reportGeneralTypeIssues]
    """Result codes: those of `optimistix.RESULTS` and three more."""

    outside_range = _OWN["outside_range"]
    infeasible = _OWN["infeasible"]
    undetermined = _OWN["undetermined"]


_Item: Any = type(optx.RESULTS.successful)


class Result(_Item):
    """One code of `RESULTS`; equal to the code of `optimistix.RESULTS` of the same name."""

    def __eq__(self, other: object) -> Any:
        return super().__eq__(_promoted(other))

    __hash__ = None

    def __ne__(self, other: object) -> Any:
        return super().__ne__(_promoted(other))


def _promoted(code: Any) -> Any:
    return RESULTS.promote(code) if isinstance(code, optx.RESULTS) else code


def as_result(code: Any) -> RESULTS:
    """A code of `RESULTS` from one of either enumeration, comparable with both."""
    item: Any = Result(*jax.tree.leaves(_promoted(code)), RESULTS)
    return item


_WORDS = {
    "nonlinear_max_steps_reached": "the solver reached its maximum number of steps.",
    "max_steps_reached": "the solver reached its maximum number of steps.",
    "nonlinear_divergence": "the solver diverged.",
    "nonfinite": "numbers that are not finite came up.",
    "nonfinite_input": "numbers that are not finite came up.",
    "singular": "the equations have no unique solution.",
}
"""Messages for the codes of optimistix."""


def is_successful(result: Any) -> Any:
    """Whether a result is a success: an array of truth values, traced or not."""
    return result == (RESULTS if isinstance(result, RESULTS) else optx.RESULTS).successful


def causes(result: Any) -> list[str]:
    """The causes of concrete failures in plain words, each once; of one result or of a batch."""
    codes: Any = RESULTS if isinstance(result, RESULTS) else optx.RESULTS
    words = {**_WORDS, **(_OWN if codes is RESULTS else {})}
    met = {name: np.any(np.asarray(result == getattr(codes, name))) for name in words}
    return list(dict.fromkeys(words[name] for name in words if met[name])) or ["the solver failed."]


def raise_unless_successful(result: Any, cure: str) -> None:
    """Raise when a concrete result is a failure; inside jit the caller must check it.

    Args:
        result: what the solver returned, one or a batch.
        cure: what the user can try.

    Raises:
        RuntimeError: cause and cure.
    """
    flag = is_successful(result)
    if is_traced(flag) or bool(np.all(np.asarray(flag))):
        return
    which = "" if np.ndim(np.asarray(flag)) == 0 else "in some cases of the batch "
    raise RuntimeError(f"No solution was found: {which}{' '.join(causes(result))} {cure}")
