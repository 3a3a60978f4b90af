"""What must be shown, and whether it is; everything follows from the JSON."""

import dataclasses
import statistics
from collections.abc import Callable, Iterator
from typing import Any

from suite import figures
from suite.case import OF_SCALAR
from suite.figures import Path, of_bound, paired, ratio, speed_up
from suite.latency import HELP, NUMPY, RECONSTRUCT
from suite.paths.counting import SAME_BYTES
from suite.paths.deep import OUR_SPLINES
from suite.paths.filtering import WITHOUT
from suite.paths.reconstruction import BM3D, COMPILED, TORCH
from suite.paths.training import DRAWN, PLAIN
from suite.probes import AS_LONG

FAST_AS_CORES = 1.8
"""On two threads; on more in proportion."""


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
    """Of all that the run measured."""
    made: list[Claim] = []
    for path in found["paths"]:
        # Every sensor is held against the same figure.
        name = "sampling" if path["name"].startswith("sampling") else path["name"]
        if name in SPEED:
            made += SPEED[name](path)
    made += agreement(found["paths"])
    made += levels(found["paths"])
    most = max(found["threads"])
    if most > 1:
        made += [with_threads(path, most) for path in found["paths"]]
    if "latency" in found:
        made += latency(found["latency"])
    return made


def network(path: Path) -> Iterator[Claim]:
    said = (
        f"{path['title']}: times as fast as PyTorch, the faster of eager and compiled, one thread"
    )
    ratios = [rival_ratio(path, name, 1) for name in (TORCH, COMPILED)]
    least = min((ratio for ratio in ratios if ratio is not None), default=None)
    yield Claim(said, 10, least, "×", bound=near(path, 1))


def network_and_denoiser(path: Path) -> Iterator[Claim]:
    yield from network(path)
    said = f"{path['title']}: times as fast as {BM3D}, one thread"
    yield Claim(said, 2000, rival_ratio(path, BM3D, 1), "×", bound=near(path, 1))


def deep(path: Path) -> Iterator[Claim]:
    of_torch, of_denoiser = DEEP[path["name"].removeprefix("deep-")]
    title, numbers = path["title"], [int(number) for number in path["seconds"]]
    for threads in numbers if of_torch else ():
        ratios = [rival_ratio(path, name, threads) for name in (TORCH, COMPILED)]
        least = min((ratio for ratio in ratios if ratio is not None), default=None)
        said = (
            f"{title}: times as fast as PyTorch, the faster of eager and compiled, "
            f"{words_of(threads)}"
        )
        module = rival_ratio(path, OUR_SPLINES, threads)
        bound = near(path, threads)
        if module is not None:
            bound += f"; {module:.1f} times as fast as PyTorch with our splines"
        yield Claim(said, of_torch, least, "×", bound=bound)
    said = f"{title}: times as fast as {BM3D}, two threads"
    yield Claim(said, of_denoiser, rival_ratio(path, BM3D, 2), "×", bound=near(path, 2))


def filtering(path: Path) -> Iterator[Claim]:
    whole = figures.bounds(path, 1)[0] / figures.median(path, "jotlight", 1)
    said = "15 × 15 filter: share of the peak of multiply-adds, one thread"
    yield Claim(said, 0.6, filter_share(path), "%", bound=f"{whole:.0%} with both splines")


def training(path: Path) -> Iterator[Claim]:
    said = (
        "Training step: times as fast as PyTorch in its quickest form, which draws too, two threads"
    )
    plain = rival_ratio(path, PLAIN, 2)
    bound = near(path, 2) + (f"; {plain:.1f} times as fast as in its first form" if plain else "")
    yield Claim(said, 25, rival_ratio(path, DRAWN, 2), "×", bound=bound)


def sampling(path: Path) -> Iterator[Claim]:
    for threads in map(int, path["seconds"]):
        # 10⁸ jots
        rate = path["items"] / figures.median(path, "jotlight", threads) / threads / 1e8
        said = f"{path['title']}: 10⁸ jots per second and thread, {words_of(threads)}"
        yield Claim(said, 5, rate, bound=near(path, threads))


def counting(path: Path) -> Iterator[Claim]:
    said = "Counting: share of the bandwidth of reading the same bytes, one thread"
    yield Claim(said, 0.5, rival_ratio(path, SAME_BYTES, 1), "%", bound=near(path, 1))


DEEP: dict[str, tuple[float | None, float]] = {
    "small": (3, 600),
    "medium": (2, 100),
    "large": (None, 40),
}
"""Times as fast as PyTorch, and as BM3D."""

SPEED: dict[str, Callable[[Path], Iterator[Claim]]] = {
    "network": network_and_denoiser,
    "network-untied": network,
    **{f"deep-{member}": deep for member in DEEP},
    "filter": filtering,
    "training": training,
    "sampling": sampling,
    "counting": counting,
}


def agreement(paths: list[Path]) -> Iterator[Claim]:
    """Nothing is timed where results differ by more, or from one number of threads to another."""
    shares = [
        difference / path["tolerance"] if difference else 0.0
        for path in paths
        for difference in path["differences"].values()
    ]
    if shares:
        said = "Largest difference from a rival's result, as a share of what is allowed"
        yield Claim(said, 1, max(shares), "%", at_most=True)


def levels(paths: list[Path]) -> Iterator[Claim]:
    """Nothing is timed where an instruction set gives something else than scalar code."""
    found = [difference for path in paths for difference in path["levels"].values()]
    if found:
        said = "Largest difference of an instruction set's result from that of scalar code, of 1"
        yield Claim(said, OF_SCALAR, max(found), at_most=True)


def with_threads(path: Path, most: int) -> Claim:
    machine = figures.peak(path, most) / figures.peak(path, 1)
    reading = figures.bandwidth(path, most) / figures.bandwidth(path, 1)
    wanted = FAST_AS_CORES * most / 2
    said = f"{path['title']}: times as fast on {words_of(most)} as on one"
    bound = f"multiply-adds alone: {machine:.2f}, reading: {reading:.2f}"
    if machine < wanted:
        return Claim(said, wanted, None, "×", bound=f"the machine was busy: {bound}")
    bound += f"; multiply-adds as long as this: {speed_up(path, most, AS_LONG):.2f}"
    return Claim(said, wanted, speed_up(path, most), "×", bound=bound)


def latency(times: dict[str, list[float]]) -> Iterator[Claim]:
    for name, wanted, what in (
        (HELP, 0.4, "start to end"),
        (RECONSTRUCT, 0.6, "481 × 321, K = 16, in all"),
    ):
        floor = paired(times[NUMPY], times[name])
        bound = f"Python and its import of NumPy take {floor:.0%} of that"
        measured = statistics.median(times[name])
        yield Claim(f"`{name}`, {what}", wanted, measured, "s", at_most=True, bound=bound)


def rival_ratio(path: Path, rival: str, threads: int) -> float | None:
    if rival not in path["seconds"].get(str(threads), {}):
        return None
    return ratio(path, rival, threads)


def filter_share(path: Path) -> float:
    """Of the peak, by the filter alone: the time with one tap is taken off, and so is that tap."""
    seconds = path["seconds"]["1"]
    pairs = zip(seconds["jotlight"], seconds[WITHOUT], strict=True)
    alone = statistics.median(whole - without for whole, without in pairs)
    return (path["slots"] - path["items"]) / figures.peak(path, 1) / alone


def near(path: Path, threads: int) -> str:
    if str(threads) not in path["seconds"]:
        return ""
    by = figures.bound_by(path, threads)
    return f"{of_bound(path, threads):.0%} of what {by} alone would allow"


def words_of(threads: int) -> str:
    return {1: "one thread", 2: "two threads"}.get(threads, f"{threads} threads")
