"""Measure what aligning and merging cost, and fit the formula that `jotlight plan` prints.

    python benchmarks/studies/motion_cost.py [--repeats 2]

The scenes are those of a shaking camera at 0.2 photons. Seconds are CPU time on one
thread, the minimum over repeats: for one image, and for a further image of a film, to which the
motion is carried. Memory is the peak of what NumPy allocates, without the bits.

The last line has the constants in `python/jotlight/motion/cost.py`: seconds = blocks (a + b pixels)
+ c pixels frames for one image and blocks (d + e pixels) for a further one, and the bytes per
pixel.
"""

import argparse
import itertools
import time
import tracemalloc

import numpy as np

import jotlight as jl
from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.films.film import film

SIZES = (128, 128), (256, 256), (256, 512)
FRAMES = 64, 256, 1024
STEP = 16
FURTHER_IMAGES = 3


def main() -> None:
    """Measure all sizes, and print the table and the fits."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeats", type=int, default=2)
    repeats = parser.parse_args().repeats
    print("| height | width | frames | seconds | seconds of a further image | MB |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    rows = []
    for size, frames in itertools.product(SIZES, FRAMES):
        bits = shaken(size, frames + FURTHER_IMAGES * STEP)
        times = [measure_seconds(bits, frames) for _ in range(repeats)]
        first, further = (min(column) for column in zip(*times, strict=True))
        memory = measure_bytes(bits[:frames])
        cells = f"{size[0]} | {size[1]} | {frames} | {first:.2f} | {further:.2f}"
        print(f"| {cells} | {memory / 1e6:.0f} |", flush=True)
        rows.append((size[0] * size[1], frames, first, further, memory))
    pixels, numbers, first, further, memory = np.array(rows).T
    blocks = np.array([len(block_edges(int(number))) - 1 for number in numbers])
    terms = np.stack([blocks, blocks * pixels, pixels * numbers])
    a, b, c = fit(terms, first)
    d, e = fit(terms[:2], further)
    constants = f"a = {a:.2g}, b = {b:.2g}, c = {c:.2g}, d = {d:.2g}, e = {e:.2g}"
    print(f"\n{constants}, {np.median(memory / pixels):.0f} bytes per pixel")


def shaken(size: tuple[int, int], frames: int) -> jl.Bits:
    """Return the bits of a shaken photograph."""
    photo = np.tile(jl.datasets.photograph("camera"), (1, 2))
    scene = jl.datasets.moving(
        photo, "shake", sensor=jl.Sensor(frames=frames), shape=size, photons=0.2, rng=0
    )
    return jl.Bits(np.asarray(scene.bits.packed), scene.bits.width)


def measure_seconds(bits: jl.Bits, window: int) -> tuple[float, float]:
    """Return the CPU time of the first image of a film, and that of a further one."""
    times = [time.process_time()]
    for image in film(bits, window=window, step=STEP, threads=1):
        times.append(time.process_time())
        assert image.is_carried == (len(times) > 2)
    return times[1] - times[0], float(np.mean(np.diff(times[1:])))


def measure_bytes(bits: jl.Bits) -> int:
    """Return the peak of the memory for aligning and merging."""
    tracemalloc.start()
    jl.merge(bits, threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def fit(terms: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the factors of the terms (m, n), at least 0, for the smallest relative errors."""
    from scipy.optimize import nnls

    return np.asarray(nnls((terms / values).T, np.ones(len(values)))[0])


if __name__ == "__main__":
    main()
