"""Time of every method per image of 481 x 321, in one interleaved run, on one core and on all."""

import contextlib
import os
import signal
import statistics
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

import jotlight as jl
from jotlight import _engine
from jotlight.experiments.experiment import (
    Experiment,
    Image,
    Lab,
    Outcome,
    Part,
    Results,
    Row,
    Update,
)
from jotlight.experiments.fig7 import part_of
from jotlight.experiments.learning import sensor_of
from jotlight.experiments.section import Claim, Column, Section, Table
from jotlight.methods import METHODS

SETTINGS = {"bits": 16, "side": None, "rounds": 12, "seed": 0}

_ENOUGH = 0.05
"""Seconds that a fast method is repeated for in each round; its median counts."""

_REST = 0.05
"""Seconds in which the threads of the one before may end their wait for more work."""


def parts(lab: Lab) -> list[Part]:
    """One: the rounds belong together."""

    def run(update: Update) -> Outcome:
        if _engine.DEBUG_BUILD:
            raise ValueError("timing: this is a debug build of jotlight; build it with --release")
        _, images = lab.data.photographs("test", 1)
        image = part_of(images[0], lab.settings["side"])
        sensor = sensor_of(lab.settings["bits"])
        packed = sensor.expose(image, lab.settings["seed"]).packed
        methods = [
            name for name, method in METHODS.items() if method.available and name != "mle-iterative"
        ]
        rows: list[Row] = []
        rounds = lab.settings["rounds"]
        with contextlib.ExitStack() as workers:
            timers = {
                cores: workers.enter_context(_worker(cores, np.asarray(packed), sensor))
                for cores in ("one core", "all cores")
                if cores == "all cores" or _can_bind()
            }
            # The first run of each loads its library.
            for number in range(-1, rounds):
                for place, method in enumerate(methods):
                    for cores, timer in timers.items():
                        seconds = timer(method)
                        if number >= 0:
                            rows.append(
                                {
                                    "cores": cores,
                                    "method": method,
                                    "round": number,
                                    "milliseconds": 1000 * seconds,
                                }
                            )
                    update((number + 1 + place / len(methods)) / (rounds + 1))
        return Outcome(rows)

    return [Part("timing", 300, run)]


@contextlib.contextmanager
def _worker(cores: str, packed: Any, sensor: jl.Sensor) -> Iterator[Callable[[str], float]]:
    """A process of its own that runs methods on one core, or on all.

    What a process has started inherits the cores that it may use, the threads of every library
    included; so one core is one core for all methods.
    """
    # Ctrl-C is for the process that waits for this one.
    ignore = (signal.SIGINT, signal.SIG_IGN)
    with ProcessPoolExecutor(
        1, mp_context=get_context("spawn"), initializer=signal.signal, initargs=ignore
    ) as pool:
        with _bound_to_one_core() if cores == "one core" else contextlib.nullcontext():
            pool.submit(os.getpid).result()
        yield lambda method: pool.submit(
            _seconds, method, packed, sensor, 1 if cores == "one core" else None
        ).result()


def _can_bind() -> bool:
    """Whether the system can bind a process to one core; Linux can, macOS cannot."""
    return hasattr(os, "sched_setaffinity")


@contextlib.contextmanager
def _bound_to_one_core() -> Iterator[None]:
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


_networks: dict[str, Callable[..., Image]] = {}
"""Those of a worker, made once: a picture's time is without the loading of a file."""


def _seconds(method: str, packed: Any, sensor: jl.Sensor, threads: int | None) -> float:
    """In a worker: the time from bits to a picture, the median of some runs."""
    bits = jl.Bits(packed)
    if method == "network":
        run = _networks.setdefault(method, jl.pretrained(sensor).reconstruct)
    elif method == "network-initial":
        run = _networks.setdefault(method, jl.Network.initial(sensor).reconstruct)
    else:
        run = partial(METHODS[method].run, sensor=sensor)
    time.sleep(_REST)
    times: list[float] = []
    while sum(times) < _ENOUGH:
        begun = time.perf_counter()
        run(bits, threads=threads)
        times.append(time.perf_counter() - begun)
    return statistics.median(times)


def section(results: Results) -> Section:
    """Medians and ratios."""
    found = results.distinct("method")
    medians = {
        cores: {
            method: float(np.median(results.numbers("milliseconds", cores=cores, method=method)))
            for method in found
        }
        for cores in results.distinct("cores")
    }
    rows = []
    for method in found:
        row: list[Any] = [METHODS[method].title]
        for cores in medians:
            median = medians[cores][method]
            row += [median, median / medians[cores]["network"]]
        rows.append(row)
    columns = [Column("method")]
    for cores in medians:
        columns += [Column(f"ms, {cores}", 2, "lowest"), Column(f"ratio, {cores}", 2)]
    size = "481 × 321" if results.settings["side"] is None else f"{results.settings['side']} square"
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        f"From bits in memory to a picture of {size} pixels, K = {results.settings['bits']}: the "
        f"median of {results.settings['rounds']} rounds, in each of which every method has its "
        f"turn, on {' and on '.join(medians)}. "
        + (
            "One core means a process bound to it, so that no library uses more. "
            if "one core" in medians
            else "This system cannot bind a process to one core, so that there are no times on "
            "one. "
        )
        + "The ratio is to the learned network.",
        "jotlight reproduce timing",
        claims=_claims(*next(iter(medians.items()))),
        tables=[Table("Time per image", columns, rows)],
    )


def _claims(cores: str, medians: dict[str, float]) -> list[Claim]:
    network = medians["network"]
    mle = network / medians["mle"]
    claims = [
        Claim(
            "MLE takes 52 ms and the learned network 453 ms: 8.7 times as long.",
            f"On {cores} MLE takes {medians['mle']:.2f} ms and the learned network "
            f"{network:.2f} ms: {mle:.1f} times as long.",
            "better" if mle < 8.7 else "not reproduced",
        )
    ]
    said = (
        "The non-iterative method with BM3D takes 2377 ms and the learned network 453 ms: the "
        "network is 5.25 times as fast (approximately 5 times less computational cost)."
    )
    if "noniterative-bm3d" not in medians:
        return [Claim(said, "BM3D was not installed.", "not tested"), *claims]
    rival = medians["noniterative-bm3d"]
    ratio = rival / network
    return [
        Claim(
            said,
            f"On {cores} the non-iterative method with BM3D takes {rival:.0f} ms and the learned "
            f"network {network:.2f} ms: the network is {ratio:.0f} times as fast.",
            "better" if ratio > 5.25 else "not reproduced",
            "Compiled code on both sides; the paper's was Matlab.",
        ),
        *claims,
    ]


EXPERIMENT = Experiment(
    "timing",
    "Time per image",
    SETTINGS,
    {**SETTINGS, "side": 96, "rounds": 2},
    parts,
    section,
    needs=("bsds300",),
)
