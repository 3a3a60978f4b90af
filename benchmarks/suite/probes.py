"""What the machine can do, measured in the same rounds as everything else."""

import functools
import time
from collections.abc import Sequence

import numpy as np

from jotlight import _engine
from suite.timing import Run

MULTIPLY_ADDS, READING = "multiply-adds", "reading"
LEAST = 0.01
"""Seconds that the multiply-adds take at least, so that starting threads does not count."""


def runs(size: int) -> dict[str, Run]:
    return {
        MULTIPLY_ADDS: lambda threads: multiply_adds(enough(), threads),
        READING: lambda threads: read_words(words(size), threads),
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


def multiply_adds(rounds: int, threads: int) -> int:
    if hasattr(_engine, "multiply_adds"):
        return _engine.multiply_adds(rounds, threads)
    return products(rounds)


def read_words(array: np.ndarray, threads: int) -> int:
    if hasattr(_engine, "read_words"):
        return _engine.read_words(array, threads)
    return int(array.sum())


def products(rounds: int, side: int = 512) -> int:
    """Products of matrices, until the engine has its own."""
    matrix = np.ones((side, side), np.float32)
    for _ in range(rounds):
        np.matmul(matrix, matrix)
    return 2 * rounds * side**3
