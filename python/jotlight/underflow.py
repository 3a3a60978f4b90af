"""Numbers that are too small for their type, and become 0."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def underflows_to_0(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return a function in which tiny numbers become 0, also if the caller makes NumPy raise.

    Probabilities far in a tail are 0 in this sense. A caller may use ``np.errstate(all="raise")``
    to find errors of their own.

    Examples
    --------
    >>> with np.errstate(all="raise"):
    ...     float(underflows_to_0(np.exp)(-1000.0))
    0.0
    """

    @functools.wraps(function)
    def call(*arguments: Arguments.args, **keywords: Arguments.kwargs) -> Result:
        with np.errstate(under="ignore"):
            return function(*arguments, **keywords)

    return call
