"""Functions of libraries that run in a thread, so that Ctrl-C works."""

import numpy as np
import pytest

from jotlight.interrupts import interruptible


def test_the_result_is_that_of_the_function():
    assert interruptible(divmod)(17, 5) == (3, 2)
    assert interruptible(sorted)([3, 1, 2], reverse=True) == [3, 2, 1]


def test_errors_of_the_thread_reach_the_caller():
    with pytest.raises(ZeroDivisionError):
        interruptible(divmod)(1, 0)


def test_the_thread_uses_the_callers_numpy_settings():
    zero = np.zeros(1)
    with np.errstate(all="raise"), pytest.raises(FloatingPointError):
        interruptible(np.divide)(1, zero)
    with np.errstate(all="ignore"):
        assert interruptible(np.divide)(1, zero) == np.inf
