"""What a verification problem gives: a quantity, what it should be, and how close it came."""

from typing import NamedTuple

import numpy as np


class Figure(NamedTuple):
    """One quantity of one problem.

    Attributes:
        problem: name of the problem.
        quantity: what was computed, with its unit.
        value: what came out.
        exact: what it should be; 0 where the value is an error itself.
        error: |value − exact|, over |exact| where that is not zero.
        target: largest error that passes.
    """

    problem: str
    quantity: str
    value: float
    exact: float
    error: float
    target: float

    @property
    def passed(self) -> bool:
        """Whether the error is within the target; false where it is not a number."""
        return bool(self.error <= self.target)


def figure(problem: str, quantity: str, value: float, exact: float, target: float) -> Figure:
    """A quantity with its relative error, absolute where the exact value is zero."""
    value, exact = float(value), float(exact)
    error = abs(value - exact) / (abs(exact) if exact else 1.0)
    return Figure(problem, quantity, value, exact, error, target)


def in_band(problem: str, quantity: str, value: float, low: float, high: float) -> Figure:
    """A quantity that should lie between two values."""
    middle = (low + high) / 2.0
    return figure(problem, quantity, value, middle, (high - low) / (2.0 * abs(middle)))


def observed_orders(sizes: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Orders of convergence log(e₁/e₂)/log(h₁/h₂) between successive sizes."""
    return np.diff(np.log(errors)) / np.diff(np.log(sizes))


def order_figure(problem: str, quantity: str, order: float, least: float, full: float) -> Figure:
    """An order of convergence; one above the full order has no error."""
    order = float(order)
    shortfall = max(full - order, 0.0) / full if np.isfinite(order) else np.nan
    return Figure(problem, quantity, order, full, shortfall, (full - least) / full)
