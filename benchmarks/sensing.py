"""Drawing bits beside NumPy's ``rng.poisson(s) >= q``, in one interleaved run.

    python benchmarks/sensing.py [--rounds 7] [--threads 2]

Prints a table of medians and ratios, and the peak memory per jot beyond input and output. Before
anything is timed, the two must agree: the share of ones of each within six standard errors.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight import _engine

SETTINGS = [
    {"oversampling": 4},
    {"oversampling": 4, "threshold": 2},
    {"oversampling": 4, "threshold": 5},
    {"oversampling": 10},
    {"oversampling": 1, "frames": 16},
    {"oversampling": 4, "kernel": "cubic"},
    {"oversampling": 4, "frames": 4, "kernel": "cubic"},
    {"oversampling": 1},
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--memory-of", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory_of:
        print(memory_per_jot(jl.Sensor(**json.loads(options.memory_of))))
        return
    if _engine.DEBUG_BUILD:
        parser.error("this is a debug build of the engine; install a release build")
    print(f"{os.cpu_count()} cores, {options.threads} threads, median of {options.rounds} rounds\n")
    print("| sensor | jotlight, ns per jot | NumPy, ns per jot | ratio | bits per jot beyond |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for setting in SETTINGS:
        sensor = jl.Sensor(**setting)
        ours, theirs = race(sensor, options.rounds, options.threads)
        command = [sys.executable, __file__, "--memory-of", json.dumps(setting)]
        memory = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        print(
            f"| `{sensor!r}` | {ours:.2f} | {theirs:.1f} | {theirs / ours:.0f} "
            f"| {float(memory):.3f} |",
            flush=True,
        )


def race(sensor: jl.Sensor, rounds: int, threads: int) -> tuple[float, float]:
    """Nanoseconds per jot of ours and NumPy's, medians of interleaved rounds."""
    side = 1024 // sensor.oversampling
    image = np.random.default_rng(0).uniform(0, 1, (side, side)).astype(np.float32)
    # Ours is so fast that it gets a larger image, to have as many milliseconds to measure.
    large = np.tile(image, (4, 4))
    rate = np.broadcast_to(sensor.rate(image), (sensor.frames, *sensor.rate(image).shape))
    rng = np.random.default_rng(1)
    ours, theirs, shares = [], [], []
    sensor.expose(large, rng, threads=threads)
    for _ in range(rounds):
        start = time.perf_counter()
        bits = sensor.expose(large, rng, threads=threads)
        middle = time.perf_counter()
        reference = rng.poisson(rate) >= sensor.threshold
        end = time.perf_counter()
        ours.append((middle - start) / np.prod(bits.shape))
        theirs.append((end - middle) / reference.size)
        shares.append((bits.counts(1).sum() / np.prod(bits.shape), reference.mean()))
    mine, numpys = np.mean(shares, axis=0)
    error = np.sqrt(numpys / (rounds * rate.size))
    assert abs(mine - numpys) < 6 * error, f"the two disagree: {mine} and {numpys}"
    return 1e9 * statistics.median(ours), 1e9 * statistics.median(theirs)


def memory_per_jot(sensor: jl.Sensor) -> float:
    """Bits of peak memory per jot, beyond input and output, in a process of its own."""
    sensor.expose(np.ones((64, 64), np.float32), 0)
    side = int((2**29 / sensor.bits_per_pixel) ** 0.5)
    image = np.random.default_rng(0).random((side, side), np.float32)
    shape = (sensor.frames, side * sensor.oversampling, -(-side * sensor.oversampling // 8))
    out = np.zeros(shape, np.uint8)
    out[...] = 1
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
    before = kilobytes("VmRSS")
    sensor.expose(image, 0, out=out)
    return (kilobytes("VmHWM") - before) * 1024 / out.size


def kilobytes(name: str) -> int:
    """A figure of this process that Linux keeps."""
    return int(Path("/proc/self/status").read_text().split(f"{name}:")[1].split()[0])


if __name__ == "__main__":
    main()
