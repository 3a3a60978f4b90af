"""Time and peak memory, in addition to input and output, of one image size.

    python benchmarks/speed/suite/one_size.py reconstruct|reconstruct-out|expose SIDE

`reconstruct-out` writes into an existing array. It prints JSON. The peak is VmHWM on Linux and 0 on
other systems.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import jotlight as jl

MIN_SECONDS, MIN_CALLS, MAX_CALLS = 0.3, 3, 1000
SENSOR = jl.Sensor(oversampling=4)
STATUS, REFERENCES = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def main() -> None:
    operation, side = sys.argv[1], int(sys.argv[2])
    run, output_bytes = OPERATIONS[operation](side)
    run()  # From here on the input's pages are in memory.
    if REFERENCES.exists():
        REFERENCES.write_text("5")  # This resets the peak.
    before = kilobytes("VmRSS")
    run()
    additional = max(0, 1024 * (kilobytes("VmHWM") - before) - output_bytes)
    seconds: list[float] = []
    # User time excludes the system's work for new pages of memory.
    user: list[float] = []
    while len(seconds) < MIN_CALLS or (sum(seconds) < MIN_SECONDS and len(seconds) < MAX_CALLS):
        start, used = time.perf_counter(), os.times().user
        run()
        seconds.append(time.perf_counter() - start)
        user.append(os.times().user - used)
    found = {
        "additional_bytes": additional,
        "seconds": seconds,
        "user_seconds": sum(user) / len(user),
    }
    print(json.dumps({"operation": operation, "side": side, **found}))


def reconstruct(side: int) -> tuple[Callable[[], object], int]:
    """Return a run from random bits to a new estimate, and the bytes of its output."""
    bits, network = bits_and_network(side)
    return lambda: network.reconstruct(bits, SENSOR, threads=1), 4 * side**2


def reconstruct_out(side: int) -> tuple[Callable[[], object], int]:
    """Return a run from random bits to an existing array, and 0 bytes of new output."""
    bits, network = bits_and_network(side)
    out = np.ones((side, side), np.float32)
    return lambda: network.reconstruct(bits, SENSOR, out=out, threads=1), 0


def bits_and_network(side: int) -> tuple[jl.Bits, jl.Network]:
    jots = side * SENSOR.oversampling
    packed = np.random.default_rng(0).integers(0, 256, (1, jots, jots // 8), np.uint8)
    return jl.Bits(packed, jots), jl.pretrained(SENSOR, "two-layer")


def expose(side: int) -> tuple[Callable[[], object], int]:
    """Return a run from an image to bits in an existing array, and 0 bytes of new output."""
    image = np.random.default_rng(0).random((side, side), np.float32)
    jots = side * SENSOR.oversampling
    out = np.ones((1, jots, jots // 8), np.uint8)
    return lambda: SENSOR.expose(image, 0, out=out, threads=1), 0


def kilobytes(name: str) -> int:
    """Return a value of this process from Linux's status file."""
    if not STATUS.exists():
        return 0
    return int(STATUS.read_text().split(f"{name}:")[1].split()[0])


OPERATIONS = {"reconstruct": reconstruct, "reconstruct-out": reconstruct_out, "expose": expose}


if __name__ == "__main__":
    main()
