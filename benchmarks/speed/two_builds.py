"""Compare two builds of jotlight in turns, with the CPU time of reconstructions.

    python benchmarks/speed/two_builds.py [--rounds 12] OLD NEW [SIZE:HEIGHT:WIDTH:THREADS ...]
    python benchmarks/speed/two_builds.py OLD NEW drawing:box:4:1 training:128:32:1
    python benchmarks/speed/two_builds.py --latency [--beside-torch] OLD NEW [...]

OLD and NEW are folders that contain the package `jotlight` with its engine. Each runs in a process
of its own. A case is a reconstruction SIZE:HEIGHT:WIDTH:THREADS, the drawing of bits
drawing:KERNEL:OVERSAMPLING:THREADS, or a training step training:SCENES:SIDE:THREADS. The builds
take turns, so that other programs on the machine slow down both. With `--latency`,
the table shows medians and 99 % quantiles of the elapsed time of 1,000 calls. With
`--beside-torch`, a thread of the same process multiplies matrices in PyTorch meanwhile.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

CASES = ["small:321:481:1", "medium:321:481:1", "large:321:481:1", "medium:64:64:1"]
LATENCY_CASES = [f"{size}:64:64:{n}" for size in ("two-layer", "small", "medium") for n in (1, 2)]
CALLS_PER_TURN = 4
LATENCY_TURNS = 10
CALLS_PER_LATENCY_TURN = 100


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("cases", nargs="*")
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--latency", action="store_true")
    parser.add_argument("--beside-torch", action="store_true")
    options = parser.parse_args()
    builds = [start(folder, options.beside_torch) for folder in (options.old, options.new)]
    if options.latency:
        compare_latencies(builds, options.cases or LATENCY_CASES)
        return
    print("| case | old, ms | new, ms | times as fast | in the median turn |")
    print("| --- | ---: | ---: | ---: | ---: |")
    calls = CALLS_PER_TURN
    for case in options.cases or CASES:
        rounds = range(options.rounds + 1)
        turns = [[min(ask(build, case, calls)[0]) for build in builds] for _ in rounds][1:]
        old, new = (min(turn[build] for turn in turns) for build in (0, 1))
        middle = statistics.median(before / after for before, after in turns)
        times = f"{1e3 * old:.2f} | {1e3 * new:.2f} | {old / new:.2f} | {middle:.2f}"
        print(f"| {case} | {times} |", flush=True)


def compare_latencies(builds: "list[subprocess.Popen[str]]", cases: list[str]) -> None:
    print("| case | old: median, 99 %, µs | new: median, 99 %, µs |")
    print("| --- | ---: | ---: |")
    for case in cases:
        times: list[list[float]] = [[], []]
        for turn in range(LATENCY_TURNS + 1):
            for build, measured in zip(builds, times, strict=True):
                elapsed = ask(build, case, CALLS_PER_LATENCY_TURN)[1]
                measured += elapsed if turn else []
        row = [f"{1e6 * statistics.median(t):.0f}, {1e6 * quantile_99(t):.0f}" for t in times]
        print(f"| {case} | {row[0]} | {row[1]} |", flush=True)


def quantile_99(times: list[float]) -> float:
    return statistics.quantiles(times, n=100)[-1]


def start(folder: str, beside_torch: bool) -> "subprocess.Popen[str]":
    """Return a process that measures a build."""
    environment = dict(os.environ, PYTHONPATH=folder, TWO_BUILDS_WORKER="1")
    if beside_torch:
        environment["TWO_BUILDS_TORCH"] = "1"
    command = [sys.executable, __file__]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)


def ask(build: "subprocess.Popen[str]", case: str, calls: int) -> list[list[float]]:
    """Return the CPU times and the elapsed times of reconstructions, in seconds."""
    assert build.stdin
    assert build.stdout
    print(case, calls, file=build.stdin, flush=True)
    times: list[list[float]] = json.loads(build.stdout.readline())
    return times


def work() -> None:
    """Answer each case on the standard input with times."""
    if os.environ.get("TWO_BUILDS_TORCH"):
        threading.Thread(target=multiply_matrices, daemon=True).start()
    known: dict[str, Callable[[], Any]] = {}
    callers: dict[str, ThreadPoolExecutor] = {}
    for line in sys.stdin:
        case, calls = line.split()
        # The first call of a thread sets the size of its pool, so each number has its own thread.
        threads = case.split(":")[-1]
        if threads not in callers:
            callers[threads] = ThreadPoolExecutor(1)
        if case not in known:
            known[case] = prepare(*case.split(":"))
        times = callers[threads].submit(measure, known[case], int(calls)).result()
        print(json.dumps(times), flush=True)


def measure(call: Callable[[], Any], calls: int) -> list[list[float]]:
    """Return the CPU times and the elapsed times of calls, in seconds."""
    processor, elapsed = [], []
    for _ in range(calls):
        begin = time.process_time(), time.perf_counter()
        call()
        processor.append(time.process_time() - begin[0])
        elapsed.append(time.perf_counter() - begin[1])
    return [processor, elapsed]


def prepare(what: str, first: str, second: str, threads: str) -> Callable[[], Any]:
    """Return a function that does the work of a case once."""
    import numpy as np

    import jotlight as jl
    from jotlight.training.cost import Cost
    from jotlight.training.parameters import parameter_vector
    from jotlight.training.patches import PatchSampler

    number = int(threads)
    if what == "drawing":
        sensor = jl.Sensor(kernel=first, oversampling=int(second))
        side = 2048 // sensor.oversampling
        image = np.random.default_rng(0).uniform(0, 1, (side, side)).astype(np.float32)
        out = np.empty_like(sensor.expose(image, 0).packed)
        return lambda: sensor.expose(image, 0, out=out, threads=number)
    sensor = jl.Sensor(oversampling=4)
    if what == "training":
        scenes, side = int(first), int(second)
        images = jl.datasets.uniform_scene((scenes, side, side), rng=0)
        network = jl.Network.initial(sensor)
        examples = PatchSampler(images, sensor, 0, scenes, side, network.halo)
        cost = Cost(network, examples, 0, 1, jl.training.SafeSet(), number)
        vector = parameter_vector(network)
        return lambda: cost.gradient(vector)
    image = jl.datasets.uniform_scene((1, int(first), int(second)), rng=0)[0]
    network, bits = jl.pretrained(sensor, what), sensor.expose(image, 0)
    return lambda: network.reconstruct(bits, sensor, threads=number)


def multiply_matrices() -> None:
    """Keep a core busy with PyTorch."""
    import torch

    torch.set_num_threads(1)
    matrix = torch.ones(512, 512)
    while True:
        torch.mm(matrix, matrix)


if __name__ == "__main__":
    work() if os.environ.get("TWO_BUILDS_WORKER") else main()
