"""Measure the time of the test for periodic rates, which all methods run on the data of cameras.

    python benchmarks/speed/periodic_rates.py [--rounds 21]

The table shows median times for 16 frames: of the test of counts; of maximum likelihood from them,
with the test and without; and of the medium network.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np

import jotlight as jl
from jotlight.calibration import find_periodic_rates
from jotlight.sensing.data.pixel_counts import gray_images

SENSOR = jl.Sensor(frames=16)


def main() -> None:
    """Time all cases, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=21)
    rounds = parser.parse_args().rounds
    print("| jots | test, ms | mle with it, ms | mle without it, ms | network, ms |")
    print("| --- | ---: | ---: | ---: | ---: |")
    network = jl.pretrained(SENSOR)
    for side in (64, 256, 512, 1024):
        counts = SENSOR.expose(np.full((side, side), 0.4), rng=0).counts()
        images = gray_images(counts)  # methods do not test these
        cases: list[Callable[[], object]] = [
            lambda counts=counts: find_periodic_rates(counts),
            lambda counts=counts: jl.mle(counts, SENSOR),
            lambda images=images: jl.mle(images, SENSOR),
            lambda images=images: network(images, SENSOR),
        ]
        times: list[list[float]] = [[] for _ in cases]
        for _ in range(rounds):
            for run, own in zip(cases, times, strict=True):
                start = time.perf_counter()
                run()
                own.append(1e3 * (time.perf_counter() - start))
        middle = " | ".join(f"{statistics.median(own):.2f}" for own in times)
        print(f"| {side} x {side} | {middle} |", flush=True)


if __name__ == "__main__":
    main()
