"""Timing of programs in turn, round by round, so all of them meet the same state of the machine."""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

from suite.threads import limited

Run = Callable[[int], object]
"""A function to time. It takes the number of threads."""

SLOW = 1.0
"""Seconds per call from which a program has few rounds."""


@dataclasses.dataclass(frozen=True)
class Effort:
    """How long to measure."""

    rounds: int
    slow_rounds: int
    """Rounds of a slow program."""
    min_seconds: float
    """Minimum seconds of a turn. A short run is repeated, and the mean is the turn's time."""
    words: int
    """Words of 64 bits to read for the machine's bandwidth, more than the caches hold."""
    pause: float
    """Seconds before a turn, because idle threads of the previous program may use the cores."""


FULL, QUICK = Effort(9, 3, 0.05, 1 << 26, 0.1), Effort(3, 1, 0.02, 1 << 23, 0.02)

Times = dict[str, dict[str, list[float]]]
"""Seconds of each turn, by number of threads and program."""


def race(runs: Mapping[str, Run], threads: Sequence[int], effort: Effort) -> Times:
    """Return the seconds of each program in each round, by number of threads."""
    times: Times = {str(number): {name: [] for name in runs} for number in threads}
    # The first call of a thread sets the size of its pool, so each number has a thread of its own.
    callers = {number: ThreadPoolExecutor(1) for number in threads}
    for _ in range(effort.rounds):
        for number in threads:
            with limited(number):
                for name, run in runs.items():
                    done = times[str(number)][name]
                    if len(done) < effort.slow_rounds or done[-1] < SLOW:
                        time.sleep(effort.pause)
                        call = callers[number].submit(turn, run, number, effort.min_seconds)
                        done.append(call.result())
    for caller in callers.values():
        caller.shutdown()
    return times


def turn(run: Run, threads: int, min_seconds: float) -> float:
    """Return the mean seconds of a call. The first call counts only if the program is slow."""
    first = seconds(run, threads, 1)
    if first > SLOW:
        return first
    return seconds(run, threads, max(1, round(min_seconds / max(first, 1e-9))))


def seconds(run: Run, threads: int, calls: int) -> float:
    """Return the mean seconds of some calls."""
    start = time.perf_counter()
    for _ in range(calls):
        run(threads)
    return (time.perf_counter() - start) / calls
