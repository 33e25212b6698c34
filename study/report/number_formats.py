"""Numbers as text for people: significant digits, signs, ranges, uncertainties."""

import math


def significant(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits; a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}g}"


def signed(value: float, decimals: int = 2) -> str:
    """A number with its sign, a true minus, and no sign on zero."""
    text = f"{value:+.{decimals}f}"
    return text.lstrip("+-") if float(text) == 0.0 else text.replace("-", "−")


def span(values: list[float], digits: int = 3) -> str:
    """Two numbers as a range."""
    return f"{values[0]:.{digits}g} to {values[1]:.{digits}g}"


def with_sd(value: float, sd: float) -> str:
    """A number and its standard deviation, both to the second significant digit of the latter."""
    if not 0.0 < sd < math.inf:
        return f"{significant(value)} ± {significant(sd, 2)}"
    digit = math.floor(math.log10(sd)) - 1
    rounded = round(value, -digit) + 0.0
    if -6 < digit < 4:
        return f"{rounded:.{max(-digit, 0)}f} ± {round(sd, -digit):.{max(-digit, 0)}f}"
    return f"{significant(rounded)} ± {significant(sd, 2)}"
