"""What must be shown, and whether it is; everything follows from the JSON."""

import dataclasses
from collections.abc import Iterator
from typing import Any

from suite import figures
from suite.figures import of_bound, paired, ratio, speed_up
from suite.latency import HELP, RECONSTRUCT
from suite.paths.counting import SAME_BYTES
from suite.paths.filtering import WITHOUT
from suite.paths.training import DRAWN
from suite.probes import MULTIPLY_ADDS

FAST_AS_CORES = 1.8
NETWORKS = ("network", "network-untied")


@dataclasses.dataclass(frozen=True)
class Claim:
    """A figure that is wanted, the figure that was measured, and what bounds it."""

    said: str
    wanted: float
    measured: float | None
    unit: str = ""
    at_most: bool = False
    bound: str = ""

    @property
    def verdict(self) -> str:
        if self.measured is None:
            return "not measured"
        met = self.measured <= self.wanted if self.at_most else self.measured >= self.wanted
        return "met" if met else "not met"


def claims(found: dict[str, Any]) -> list[Claim]:
    paths = {path["name"]: path for path in found["paths"]}
    return [*speed(paths), *with_threads(paths, max(found["threads"])), *latency(found)]


def speed(paths: dict[str, figures.Path]) -> Iterator[Claim]:
    for name in NETWORKS:
        path = paths.get(name)
        title = path["title"] if path else name
        for rival, wanted in (("PyTorch, the same network", 10), ("non-iterative, BM3D", 2000)):
            said = f"{title}: times as fast as {rival}, one thread"
            yield Claim(said, wanted, rival_ratio(path, rival, 1), "×", bound=near(path, 1))
    path = paths.get("filter")
    whole = f"{path_share(path):.0%} with both splines" if path else ""
    yield Claim("15 × 15 filter: share of the multiply-adds' peak, one thread", 0.6,
                filter_share(path), "%", bound=whole)  # fmt: skip
    path = paths.get("training")
    said = "Training step: times as fast as PyTorch, which draws bits too, two threads"
    yield Claim(said, 25, rival_ratio(path, DRAWN, 2), "×", bound=near(path, 2))
    path = paths.get("sampling")
    for threads in threads_of(path):
        said = f"Drawing bits at q = 1: 10⁸ jots per second and thread, {words_of(threads)}"
        yield Claim(said, 5, jots(path, threads), bound=near(path, threads))
    path = paths.get("counting")
    said = "Counting: share of the bandwidth of reading the same bytes, one thread"
    yield Claim(said, 0.5, rival_ratio(path, SAME_BYTES, 1), "%", bound=near(path, 1))


def with_threads(paths: dict[str, figures.Path], most: int) -> Iterator[Claim]:
    for path in paths.values():
        if most > 1:
            machine = speed_up(path, most, MULTIPLY_ADDS)
            yield Claim(
                f"{path['title']}: times as fast on {words_of(most)} as on one",
                FAST_AS_CORES * most / 2,
                speed_up(path, most),
                "×",
                bound=f"multiply-adds alone, in the same rounds: {machine:.2f} times",
            )


def latency(found: dict[str, Any]) -> Iterator[Claim]:
    times = found.get("latency")
    for name, wanted in ((HELP, 0.4), (RECONSTRUCT, 0.6)):
        measured = paired(times[name], [1.0] * len(times[name])) if times else None
        bound = ""
        if times:
            python = paired(times["python, import numpy"], times[name])
            bound = f"Python and the import of NumPy take {python:.0%} of it"
        said = f"`{name}`, " + ("start to end" if name == HELP else "481 × 321, K = 16, in all")
        yield Claim(said, wanted, measured, "s", at_most=True, bound=bound)


def rival_ratio(path: figures.Path | None, rival: str, threads: int) -> float | None:
    if path is None or rival not in path["seconds"].get(str(threads), {}):
        return None
    return ratio(path, rival, threads)


def filter_share(path: figures.Path | None) -> float | None:
    """Of the peak, by the filter alone: the time with one tap is taken off, and so is that tap."""
    if path is None:
        return None
    seconds = path["seconds"]["1"]
    pairs = zip(seconds["jotlight"], seconds[WITHOUT], strict=True)
    alone = paired([whole - without for whole, without in pairs], [1.0] * len(seconds[WITHOUT]))
    return (path["slots"] - path["items"]) / figures.peak(path, 1) / alone


def path_share(path: figures.Path) -> float:
    return figures.bounds(path, 1)[0] / figures.median(path, "jotlight", 1)


def jots(path: figures.Path | None, threads: int) -> float | None:
    """10⁸ jots per second and thread."""
    if path is None:
        return None
    return path["items"] / figures.median(path, "jotlight", threads) / threads / 1e8


def near(path: figures.Path | None, threads: int) -> str:
    if path is None or str(threads) not in path["seconds"]:
        return ""
    by = figures.bound_by(path, threads)
    return f"{of_bound(path, threads):.0%} of what {by} alone would allow"


def threads_of(path: figures.Path | None) -> list[int]:
    return [int(number) for number in path["seconds"]] if path else [1]


def words_of(threads: int) -> str:
    return {1: "one thread", 2: "two threads"}.get(threads, f"{threads} threads")
