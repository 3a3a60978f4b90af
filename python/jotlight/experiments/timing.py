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
import jotlight._engine as engine
from jotlight.evaluation.methods import DEEP_NETWORKS, METHODS
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
from jotlight.experiments.names import UNTIED, title
from jotlight.experiments.report.section import Claim, Column, Section, Table, Verdict

SETTINGS = {"bits": 16, "side": None, "rounds": 12, "seed": 0}

_ENOUGH = 0.05
"""Seconds that a fast method is repeated for in each round; its median counts."""

_BESIDE_BM3D, _BESIDE_MLE = 5.25, 8.7
"""The paper's ratios of times."""

_NEAR = 0.25
"""By how much a ratio may differ and still count as reproduced."""

_REST = 0.05
"""Seconds in which the threads of the one before may end their wait for more work."""


def parts(lab: Lab) -> list[Part]:
    """One: the rounds belong together."""

    def run(update: Update) -> Outcome:
        if engine.DEBUG_BUILD:
            raise ValueError("timing: this is a debug build of jotlight; build it with --release")
        _, images = lab.data.photographs("test", 1)
        image = part_of(images[0], lab.settings["side"])
        sensor = sensor_of(lab.settings["bits"])
        packed = sensor.expose(image, lab.settings["seed"]).packed
        methods = [
            name
            for name, method in METHODS.items()
            if method.available and name not in ("mle-iterative", *DEEP_NETWORKS)
        ] + [UNTIED]
        rows: list[Row] = []
        rounds = lab.settings["rounds"]
        with contextlib.ExitStack() as workers:
            pools = {
                cores: workers.enter_context(worker(cores))
                for cores in ("one core", "all cores")
                if cores == "all cores" or _can_bind()
            }
            # The first run of each loads its library.
            for number in range(-1, rounds):
                for place, method in enumerate(methods):
                    for cores, pool in pools.items():
                        threads = 1 if cores == "one core" else None
                        work = pool.submit(_seconds, method, np.asarray(packed), sensor, threads)
                        seconds = work.result()
                        if number >= 0:
                            rows.append(
                                {
                                    "cores": cores,
                                    "method": method,
                                    "round": number,
                                    "height": image.shape[0],
                                    "width": image.shape[1],
                                    "milliseconds": 1000 * seconds,
                                }
                            )
                    update((number + 1 + place / len(methods)) / (rounds + 1))
        return Outcome(rows)

    return [Part("timing", 300, run)]


@contextlib.contextmanager
def worker(cores: str) -> Iterator[ProcessPoolExecutor]:
    """A process of its own, bound to one core or free to use all.

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
        yield pool


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
    if method == "network-two-layer":
        run = _networks.setdefault(method, jl.pretrained(sensor, "two-layer").reconstruct)
    elif method == UNTIED:
        network = jl.Network.initial(sensor, tied=False)
        run = _networks.setdefault(method, network.reconstruct)
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
        row: list[Any] = [title(method)]
        for cores in medians:
            median = medians[cores][method]
            row += [median, median / medians[cores]["network-two-layer"]]
        rows.append(row)
    columns = [Column("method")]
    for cores in medians:
        columns += [Column(f"ms, {cores}", 2, "lowest"), Column(f"ratio, {cores}", 2)]
    first = results.rows[0]
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        f"From bits in memory to a picture of {first['width']} × {first['height']} pixels, K = "
        f"{results.settings['bits']}: the median of {results.settings['rounds']} rounds, in each "
        f"of which every method has its turn, on {' and on '.join(medians)}. "
        + (
            "One core means a process bound to it, so that no library uses more. "
            if "one core" in medians
            else "This system cannot bind a process to one core, so that there are no times on "
            "one. "
        )
        + "The ratio is to the learned network. That and the initial one have one weight for all "
        "jots of a pixel; the paper's has one for each jot, which takes longer.",
        "jotlight reproduce timing",
        claims=_claims(*next(iter(medians.items()))),
        tables=[Table("Time per image", columns, rows)],
    )


def _claims(cores: str, medians: dict[str, float]) -> list[Claim]:
    """About the paper's own network, with a weight for each jot."""
    network, mle = medians[UNTIED], medians["mle"]
    times = f"On {cores} the network with a weight for each jot takes {network:.2f} ms"
    claims = [
        Claim(
            f"MLE takes 52 ms and the learned network 453 ms: {_BESIDE_MLE} times as long.",
            f"{times} and MLE {mle:.2f} ms: {network / mle:.1f} times as long (with one weight for "
            f"all jots {medians['network-two-layer'] / mle:.1f} times).",
            _verdict(network / mle),
            f"Within {_NEAR:.0%} of the paper's ratio counts as reproduced, less as better.",
        )
    ]
    said = (
        "The non-iterative method with BM3D takes 2377 ms and the learned network 453 ms: the "
        f"network is {_BESIDE_BM3D} times as fast (approximately 5 times less computational cost)."
    )
    if "noniterative-bm3d" not in medians:
        return [Claim(said, "BM3D was not installed.", "not tested"), *claims]
    rival = medians["noniterative-bm3d"]
    ratio = rival / network
    return [
        Claim(
            said,
            f"{times} and the non-iterative method with BM3D {rival:.0f} ms: the network is "
            f"{ratio:.0f} times as fast (with one weight for all jots "
            f"{rival / medians['network-two-layer']:.0f} times).",
            "better" if ratio > _BESIDE_BM3D else "not reproduced",
            f"Our network is {453 / network:.0f} times as fast as the paper's in Matlab on another "
            f"processor; BM3D's package takes {rival / 2377:.1f} times as long as the paper's.",
        ),
        *claims,
    ]


def _verdict(beside_mle: float) -> Verdict:
    if beside_mle < (1 - _NEAR) * _BESIDE_MLE:
        return "better"
    return "reproduced" if beside_mle <= (1 + _NEAR) * _BESIDE_MLE else "not reproduced"


EXPERIMENT = Experiment(
    "timing",
    "Time per image",
    SETTINGS,
    {**SETTINGS, "side": 96, "rounds": 2},
    parts,
    section,
    needs=("bsds300",),
)
