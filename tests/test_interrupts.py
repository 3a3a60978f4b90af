"""Libraries during which Ctrl-C works, and libraries that it does not interrupt."""

import signal
import threading

import numpy as np
import pytest

from jotlight.interrupts import hold_signals, interruptible


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


def test_a_held_signal_is_raised_where_the_block_may_end():
    before = signal.getsignal(signal.SIGINT)
    steps = []

    def work():
        with hold_signals() as raise_held:
            raise_held()
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            steps.append("held")
            raise_held()
            steps.append("not reached")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert steps == ["held"]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_held_signal_is_raised_at_the_end_of_the_block():
    steps = []

    def work():
        with hold_signals():
            signal.raise_signal(signal.SIGINT)
            steps.append("held")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert steps == ["held"]


def test_other_threads_have_no_signals_to_hold():
    errors = []

    def work():
        try:
            with hold_signals() as raise_held:
                raise_held()
        except ValueError as error:
            errors.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert errors == []


def test_no_signal_is_lost():
    received = []
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: received.append((number, frame is not None)))
    try:
        with hold_signals():
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGTERM):
                signal.raise_signal(number)
            assert received == []
    finally:
        for number, own in zip((signal.SIGINT, signal.SIGTERM), before, strict=True):
            signal.signal(number, own)
    assert received == [(signal.SIGTERM, True), (signal.SIGINT, True)]
