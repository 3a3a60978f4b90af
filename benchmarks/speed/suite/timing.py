"""Contenders in turn, round by round, so that all of them meet the machine in the same moods."""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence

from suite.threads import limited

Run = Callable[[int], object]
"""What is timed; it takes the number of threads."""

SLOW = 1.0
"""A contender that takes so many seconds a call has few rounds."""


@dataclasses.dataclass(frozen=True)
class Effort:
    """How long to measure."""

    rounds: int
    few: int
    """Rounds of a slow one."""
    least: float
    """Seconds in a turn at least; a short run is repeated so long, and its mean is the turn's."""
    words: int
    """Words of 64 bits that are read to find the machine's bandwidth: more than caches hold."""
    pause: float
    """Seconds before a turn: threads of the one before may wait for work at full speed."""


FULL, QUICK = Effort(9, 3, 0.05, 1 << 26, 0.1), Effort(3, 1, 0.02, 1 << 23, 0.02)

Times = dict[str, dict[str, list[float]]]
"""Seconds of each turn, by number of threads and contender."""


def race(runs: Mapping[str, Run], threads: Sequence[int], effort: Effort) -> Times:
    """Seconds of each contender, once per round and number of threads."""
    times: Times = {str(number): {name: [] for name in runs} for number in threads}
    for _ in range(effort.rounds):
        for number in threads:
            with limited(number):
                for name, run in runs.items():
                    done = times[str(number)][name]
                    if len(done) < effort.few or done[-1] < SLOW:
                        time.sleep(effort.pause)
                        done.append(turn(run, number, effort.least))
    return times


def turn(run: Run, threads: int, least: float) -> float:
    """Seconds of one call: the first is not counted, unless it takes far too long to be cold."""
    first = seconds(run, threads, 1)
    if first > SLOW:
        return first
    return seconds(run, threads, max(1, round(least / max(first, 1e-9))))


def seconds(run: Run, threads: int, times: int) -> float:
    begun = time.perf_counter()
    for _ in range(times):
        run(threads)
    return (time.perf_counter() - begun) / times
