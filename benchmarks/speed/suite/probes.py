"""What the machine can do, measured in the same rounds as everything else."""

import functools
import time
import timeit
from collections.abc import Sequence

import numpy as np

import jotlight._engine as engine
from suite.timing import Run

MULTIPLY_ADDS, READING, AS_LONG = "multiply-adds", "reading", "multiply-adds as long as ours"
LEAST = 0.01
"""Seconds that the multiply-adds take at least, so that starting threads does not count."""


def runs(size: int, ours: Run) -> dict[str, Run]:
    alike = as_long_as(ours)
    return {
        MULTIPLY_ADDS: lambda threads: multiply_adds(enough(), threads),
        READING: lambda threads: read_words(words(size), threads),
        AS_LONG: lambda threads: multiply_adds(max(1, alike // threads), threads),
    }


def work(threads: Sequence[int], size: int) -> dict[str, object]:
    """Floating-point operations by number of threads, and bytes read, of one call."""
    operations = {str(number): multiply_adds(enough(), number) for number in threads}
    return {"operations": operations, "bytes": words(size).nbytes}


@functools.cache
def words(size: int) -> np.ndarray:
    return np.arange(size, dtype=np.uint64)


@functools.cache
def enough() -> int:
    """Rounds of multiply-adds that take as long as that."""
    rounds = 1
    while True:
        begun = time.perf_counter()
        multiply_adds(rounds, 1)
        if time.perf_counter() - begun > LEAST:
            return rounds
        rounds *= 2


def as_long_as(run: Run) -> int:
    """Rounds of multiply-adds that take one thread as long as this does.

    Shared by several threads, they are as much faster as a call of that length can be, for the
    threads have to be woken.
    """
    alone, ours = (
        min(timeit.repeat(lambda call=call: call(1), number=1, repeat=3))
        for call in (lambda threads: multiply_adds(enough(), threads), run)
    )
    return max(1, round(enough() * ours / alone))


def multiply_adds(rounds: int, threads: int) -> int:
    """Fused multiply-adds in registers; gives the operations, two for each."""
    return engine.multiply_adds(rounds, threads)


def read_words(array: np.ndarray, threads: int) -> int:
    """The sum of many words, which takes as long as reading them."""
    return engine.read_words(array, threads)
