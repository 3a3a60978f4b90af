"""Compare two builds of jotlight in turns, with the processor time of reconstructions.

    python benchmarks/speed/two_builds.py [--rounds 12] OLD NEW [SIZE:HEIGHT:WIDTH:THREADS ...]

OLD and NEW are folders that contain the package `jotlight` with its engine. Each runs in a process
of its own. They take turns, so that other programs on the machine slow down both.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from typing import Any

CASES = ["small:321:481:1", "medium:321:481:1", "large:321:481:1", "medium:64:64:1"]
CALLS_PER_TURN = 4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("cases", nargs="*", default=CASES)
    parser.add_argument("--rounds", type=int, default=12)
    options = parser.parse_args()
    builds = [start(folder) for folder in (options.old, options.new)]
    print("| case | old, ms | new, ms | times as fast | in the median turn |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for case in options.cases:
        turns = [[ask(build, case) for build in builds] for _ in range(options.rounds + 1)][1:]
        old, new = (min(turn[build] for turn in turns) for build in (0, 1))
        middle = statistics.median(before / after for before, after in turns)
        times = f"{1e3 * old:.2f} | {1e3 * new:.2f} | {old / new:.2f} | {middle:.2f}"
        print(f"| {case} | {times} |", flush=True)


def start(folder: str) -> "subprocess.Popen[str]":
    """Return a process that measures a build."""
    environment = dict(os.environ, PYTHONPATH=folder, TWO_BUILDS_WORKER="1")
    command = [sys.executable, __file__]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)


def ask(build: "subprocess.Popen[str]", case: str) -> float:
    """Return the least processor time of a reconstruction in one turn, in seconds."""
    assert build.stdin
    assert build.stdout
    print(case, file=build.stdin, flush=True)
    return float(json.loads(build.stdout.readline()))


def work() -> None:
    """Answer each case on the standard input with a time."""
    import jotlight as jl

    sensor = jl.Sensor(oversampling=4)
    inputs: dict[str, Any] = {}
    for line in sys.stdin:
        size, height, width, threads = line.strip().split(":")
        if line not in inputs:
            image = jl.datasets.uniform_scene((1, int(height), int(width)), rng=0)[0]
            inputs[line] = jl.pretrained(sensor, size), sensor.expose(image, 0)
        network, bits = inputs[line]
        times = []
        for _ in range(CALLS_PER_TURN):
            begin = time.process_time()
            network.reconstruct(bits, sensor, threads=int(threads))
            times.append(time.process_time() - begin)
        print(json.dumps(min(times)), flush=True)


if __name__ == "__main__":
    work() if os.environ.get("TWO_BUILDS_WORKER") else main()
