"""Compare two builds of jotlight in turns, with the processor time of reconstructions.

    python benchmarks/speed/two_builds.py [--rounds 12] OLD NEW [SIZE:HEIGHT:WIDTH:THREADS ...]
    python benchmarks/speed/two_builds.py --latency [--beside-torch] OLD NEW [...]

OLD and NEW are folders that contain the package `jotlight` with its engine. Each runs in a process
of its own. They take turns, so that other programs on the machine slow down both. With `--latency`,
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
    """Return the processor times and the elapsed times of reconstructions, in seconds."""
    assert build.stdin
    assert build.stdout
    print(case, calls, file=build.stdin, flush=True)
    times: list[list[float]] = json.loads(build.stdout.readline())
    return times


def work() -> None:
    """Answer each case on the standard input with times."""
    import jotlight as jl

    if os.environ.get("TWO_BUILDS_TORCH"):
        threading.Thread(target=multiply_matrices, daemon=True).start()
    sensor = jl.Sensor(oversampling=4)
    inputs: dict[str, Any] = {}
    for line in sys.stdin:
        case, calls = line.split()
        size, height, width, threads = case.split(":")
        if case not in inputs:
            image = jl.datasets.uniform_scene((1, int(height), int(width)), rng=0)[0]
            inputs[case] = jl.pretrained(sensor, size), sensor.expose(image, 0)
        network, bits = inputs[case]
        processor, elapsed = [], []
        for _ in range(int(calls)):
            begin = time.process_time(), time.perf_counter()
            network.reconstruct(bits, sensor, threads=int(threads))
            processor.append(time.process_time() - begin[0])
            elapsed.append(time.perf_counter() - begin[1])
        print(json.dumps([processor, elapsed]), flush=True)


def multiply_matrices() -> None:
    """Keep a core busy with PyTorch."""
    import torch

    torch.set_num_threads(1)
    matrix = torch.ones(512, 512)
    while True:
        torch.mm(matrix, matrix)


if __name__ == "__main__":
    work() if os.environ.get("TWO_BUILDS_WORKER") else main()
