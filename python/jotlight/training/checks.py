"""What the numbers that a run is given have to be."""

import math
import operator


def at_least(name: str, value: int, least: int) -> int:
    """Give a whole number that is not less than `least`.

    Raises
    ------
    TypeError, ValueError
        When it is no whole number, or less.

    Examples
    --------
    >>> at_least("steps", 3, 1)
    3
    """
    try:
        value = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected a whole number, got {value!r}") from None
    if value < least:
        raise ValueError(f"{name}: expected at least {least}, got {value}")
    return value


def above_0(name: str, value: float) -> float:
    """Give a finite number above 0.

    Raises
    ------
    ValueError
        When it is another one.

    Examples
    --------
    >>> above_0("rate", 1e-3)
    0.001
    """
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name}: expected a finite number above 0, got {value}")
    return value
