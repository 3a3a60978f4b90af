"""Probes of what the machine can do, measured in the same rounds as everything else."""

import functools
import time
import timeit
from collections.abc import Sequence

import numpy as np

import jotlight._engine as engine
from suite.timing import Run

MULTIPLY_ADDS, READING = "multiply-adds", "reading"
SAME_DURATION = "multiply-adds of the same duration"
MIN_SECONDS = 0.01
"""Minimum seconds of the multiply-adds, which makes the start of threads negligible."""


def runs(size: int, run: Run) -> dict[str, Run]:
    """Return the probes beside a run, with `size` words to read."""
    rounds = rounds_as_long_as(run)
    return {
        MULTIPLY_ADDS: lambda threads: multiply_adds(calibrated_rounds(), threads),
        READING: lambda threads: read_words(words(size), threads),
        SAME_DURATION: lambda threads: multiply_adds(max(1, rounds // threads), threads),
    }


def work(threads: Sequence[int], size: int) -> dict[str, object]:
    """Return the floating-point operations by number of threads, and the bytes, of one call."""
    operations = {str(number): multiply_adds(calibrated_rounds(), number) for number in threads}
    return {"operations": operations, "bytes": words(size).nbytes}


@functools.cache
def words(size: int) -> np.ndarray:
    """Return an array to read."""
    return np.arange(size, dtype=np.uint64)


@functools.cache
def calibrated_rounds() -> int:
    """Return a number of rounds that takes at least the minimum seconds."""
    rounds = 1
    while True:
        start = time.perf_counter()
        multiply_adds(rounds, 1)
        if time.perf_counter() - start > MIN_SECONDS:
            return rounds
        rounds *= 2


def rounds_as_long_as(run: Run) -> int:
    """Return the rounds of multiply-adds that take one thread as long as a run does.

    Divided among several threads, they show the largest speedup of a call of that duration,
    because it takes time to wake threads.
    """
    probe, target = (
        min(timeit.repeat(lambda call=call: call(1), number=1, repeat=3))
        for call in (lambda threads: multiply_adds(calibrated_rounds(), threads), run)
    )
    return max(1, round(calibrated_rounds() * target / probe))


def multiply_adds(rounds: int, threads: int) -> int:
    """Run fused multiply-adds in registers, and return the operations, two for each."""
    return engine.multiply_adds(rounds, threads)


def read_words(array: np.ndarray, threads: int) -> int:
    """Return the sum of many words, which takes as long as reading them."""
    return engine.read_words(array, threads)
