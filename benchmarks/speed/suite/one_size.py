"""One size in a process of its own: seconds, and peak memory beyond input and output.

    python benchmarks/speed/suite/one_size.py reconstruct|expose SIDE

Prints JSON. The peak is Linux's own (VmHWM), and 0 elsewhere.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import jotlight as jl

LEAST, FEWEST = 0.3, 3
SENSOR = jl.Sensor(oversampling=4)
STATUS, REFERENCES = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def main() -> None:
    what, side = sys.argv[1], int(sys.argv[2])
    run, held = {"reconstruct": reconstruct, "expose": expose}[what](side)
    run()  # the pages of what is given are there from now on
    if REFERENCES.exists():
        REFERENCES.write_text("5")  # forget the peak so far
    before = kilobytes("VmRSS")
    run()
    beyond = max(0, 1024 * (kilobytes("VmHWM") - before) - held)
    seconds: list[float] = []
    # Of the processor, for the program alone: without the system's work for pages that are new.
    own: list[float] = []
    while len(seconds) < FEWEST or (sum(seconds) < LEAST and len(seconds) < 1000):
        begun, used = time.perf_counter(), os.times().user
        run()
        seconds.append(time.perf_counter() - begun)
        own.append(os.times().user - used)
    found = {"beyond": beyond, "seconds": seconds, "own": sum(own) / len(own)}
    print(json.dumps({"what": what, "side": side, **found}))


def reconstruct(side: int) -> tuple[Callable[[], object], int]:
    """Random bits to a picture, which is new each time."""
    jots = side * SENSOR.oversampling
    packed = np.random.default_rng(0).integers(0, 256, (1, jots, jots // 8), np.uint8)
    bits = jl.Bits(packed, jots)
    network = jl.pretrained(SENSOR, "two-layer")
    return lambda: network.reconstruct(bits, SENSOR, threads=1), 4 * side**2


def expose(side: int) -> tuple[Callable[[], object], int]:
    """A picture to bits, in an array that is there."""
    image = np.random.default_rng(0).random((side, side), np.float32)
    jots = side * SENSOR.oversampling
    out = np.ones((1, jots, jots // 8), np.uint8)
    return lambda: SENSOR.expose(image, 0, out=out, threads=1), 0


def kilobytes(name: str) -> int:
    """A figure of this process that Linux keeps."""
    if not STATUS.exists():
        return 0
    return int(STATUS.read_text().split(f"{name}:")[1].split()[0])


if __name__ == "__main__":
    main()
