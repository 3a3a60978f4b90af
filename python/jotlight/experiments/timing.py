"""Time of every method per image of 481 x 321 in one interleaved run, on one core and on all."""

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

from jotlight._engine import DEBUG_BUILD
from jotlight.array_types import Image
from jotlight.datasets.fetch import Progress
from jotlight.evaluation.methods import METHODS
from jotlight.evaluation.own_method import import_method
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.experiments.bsds_methods import TWO_LAYER_METHOD, crop_center, methods_for
from jotlight.experiments.experiment import (
    Experiment,
    Part,
    PartResult,
    Results,
    Row,
    RunContext,
    command_of,
)
from jotlight.experiments.method_titles import UNTIED, method_title
from jotlight.experiments.report.content import Claim, Column, Section, Table, Verdict
from jotlight.experiments.training_runs import paper_sensor
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.sensor import Sensor

SETTINGS = {"bits": 16, "side": None, "rounds": 12, "seed": 0}

_MIN_TURN = 0.05
"""Minimum seconds of a turn. A fast method runs repeatedly, and the median counts."""

_BM3D_RATIO, _MLE_RATIO = 5.25, 8.7
"""The paper's ratios of times: BM3D to network, and network to MLE."""

_RATIO_TOLERANCE = 0.25
"""Maximum relative difference of a ratio that counts as reproduced."""

_PAUSE = 0.05
"""Seconds before a turn, in which the threads of the previous method stop waiting for work."""


def parts(context: RunContext) -> list[Part]:
    """Return one part, because the rounds belong together."""
    return [Part("timing", 300, partial(_run, context))]


def _run(context: RunContext, progress: Progress) -> PartResult:
    if DEBUG_BUILD:
        raise ValueError("timing: this is a debug build of jotlight; build it with --release")
    settings = context.settings
    _, images = context.data.bsds300("test", 1)
    image = crop_center(images[0], settings["side"])
    sensor = paper_sensor(settings["bits"])
    packed = np.asarray(sensor.expose(image, settings["seed"]).packed)
    methods = [*methods_for(sensor), UNTIED, *context.own]
    rows: list[Row] = []
    rounds = settings["rounds"]
    with contextlib.ExitStack() as workers:
        pools = {
            cores: workers.enter_context(worker(cores))
            for cores in ("one core", "all cores")
            if cores == "all cores" or _can_bind()
        }
        # Round -1 is not counted: the first run of each method loads its library.
        for number in range(-1, rounds):
            for place, method in enumerate(methods):
                for cores, pool in pools.items():
                    threads = 1 if cores == "one core" else None
                    seconds = pool.submit(_seconds, method, packed, sensor, threads).result()
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
                progress((number + 1 + place / len(methods)) / (rounds + 1))
    return PartResult(rows)


@contextlib.contextmanager
def worker(cores: str) -> Iterator[ProcessPoolExecutor]:
    """Provide a process of its own, bound to one core or free to use all.

    The threads that a process starts inherit its cores, including those of every library. One
    core is therefore one core for all methods.
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
    """Return whether the system can bind a process to one core. Linux can, macOS cannot."""
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
"""The networks and own functions of a worker, loaded once so the times exclude the loading."""


def _seconds(method: str, packed: Any, sensor: Sensor, threads: int | None) -> float:
    """Return a worker's median time from bits to an estimate."""
    bits = Bits(packed)
    if method == TWO_LAYER_METHOD:
        run = _networks.setdefault(method, pretrained(sensor, "two-layer").reconstruct)
    elif method == UNTIED:
        run = _networks.setdefault(method, Network.initial(sensor, tied=False).reconstruct)
    elif ":" in method:
        run = _networks.setdefault(
            method, partial(reconstruct, sensor=sensor, method=import_method(method))
        )
    elif method == "network-initial":
        run = _networks.setdefault(method, Network.initial(sensor).reconstruct)
    else:
        run = partial(METHODS[method].run, sensor=sensor)
    time.sleep(_PAUSE)
    times: list[float] = []
    while sum(times) < _MIN_TURN:
        start = time.perf_counter()
        run(bits, threads=threads)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def section(results: Results) -> Section:
    """Return the median times and their ratios."""
    methods = results.unique("method")
    medians = {
        cores: {
            method: float(np.median(results.column("milliseconds", cores=cores, method=method)))
            for method in methods
        }
        for cores in results.unique("cores")
    }
    rows = []
    for method in methods:
        row: list[Any] = [method_title(method)]
        for cores in medians:
            median = medians[cores][method]
            row += [median, median / medians[cores][TWO_LAYER_METHOD]]
        rows.append(row)
    columns = [Column("method")]
    for cores in medians:
        columns += [Column(f"ms, {cores}", ".2f", "lowest"), Column(f"ratio, {cores}", ".2f")]
    first = results.rows[0]
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        f"From bits in memory to an estimate of {first['width']} × {first['height']} pixels, K = "
        f"{results.settings['bits']}: the median of {results.settings['rounds']} rounds on "
        f"{' and on '.join(medians)}. All methods take turns in each round. "
        + (
            "On one core, the process is bound to the core, so no library uses more. "
            if "one core" in medians
            else "This system cannot bind a process to one core, so there are no times on one. "
        )
        + "The ratio is to the learned network. The learned and the initial network have one "
        "weight for all jots of a pixel. The paper's network has one for each jot, which takes "
        "longer.",
        command_of(EXPERIMENT.name, results.settings),
        ["timing.csv"],
        claims=_claims(*next(iter(medians.items()))),
        tables=[Table("Time per image", columns, rows)],
    )


def _claims(cores: str, medians: dict[str, float]) -> list[Claim]:
    """Return the claims about the paper's own network, with a weight for each jot."""
    network, mle = medians[UNTIED], medians["mle"]
    times = f"On {cores} the network with a weight for each jot takes {network:.2f} ms"
    claims = [
        Claim(
            f"MLE takes 52 ms and the learned network 453 ms: {_MLE_RATIO} times as long.",
            f"{times} and MLE {mle:.2f} ms: {network / mle:.1f} times as long (with one weight for "
            f"all jots {medians[TWO_LAYER_METHOD] / mle:.1f} times).",
            _mle_verdict(network / mle),
            f"A ratio within {_RATIO_TOLERANCE:.0%} of the paper's counts as reproduced, a lower "
            "one as better.",
        )
    ]
    statement = (
        "The non-iterative method with BM3D takes 2377 ms and the learned network 453 ms: the "
        f"network is {_BM3D_RATIO} times as fast (approximately 5 times less computational cost)."
    )
    if "noniterative-bm3d" not in medians:
        return [Claim(statement, "BM3D was not installed.", "not tested"), *claims]
    bm3d = medians["noniterative-bm3d"]
    ratio = bm3d / network
    return [
        Claim(
            statement,
            f"{times} and the non-iterative method with BM3D {bm3d:.0f} ms: the network is "
            f"{ratio:.0f} times as fast (with one weight for all jots "
            f"{bm3d / medians[TWO_LAYER_METHOD]:.0f} times).",
            "better" if ratio > _BM3D_RATIO else "not reproduced",
            f"jotlight's network is {453 / network:.0f} times as fast as the paper's in MATLAB on "
            f"another processor; BM3D's package takes {bm3d / 2377:.1f} times as long as the "
            "paper's.",
        ),
        *claims,
    ]


def _mle_verdict(ratio: float) -> Verdict:
    if ratio < (1 - _RATIO_TOLERANCE) * _MLE_RATIO:
        return "better"
    return "reproduced" if ratio <= (1 + _RATIO_TOLERANCE) * _MLE_RATIO else "not reproduced"


EXPERIMENT = Experiment(
    "timing",
    "Time per image",
    SETTINGS,
    {**SETTINGS, "side": 96, "rounds": 2},
    parts,
    section,
    compares_methods=True,
    datasets=("bsds300",),
)
