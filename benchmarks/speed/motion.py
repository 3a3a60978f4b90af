"""Compare the time of aligned images with that of the network that estimates them.

    python benchmarks/speed/motion.py [--frames 1000 10000] [--rounds 3] [--processor]

The frames have 256 x 512 jots, with 0.2 photons per jot and frame on average, and come from a
camera that shakes. The table shows the best time of several rounds, and its ratio to that of the
network "medium" for an image of this size: of the whole path from bits to an image, for bursts of
different lengths, and of an image of a film with a window of 256 frames and a step of 16, whose
motion is carried from the image before. With --processor, times are those of the processor for one
thread, which depend less on other programs.
"""

import argparse
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

import jotlight as jl
from jotlight.motion.films.film import film
from jotlight.motion.films.image import FilmImage

SIZE = 256, 512
WINDOW, STEP = 256, 16
FILM_IMAGES = 6


def main() -> None:
    """Record bursts, and time all cases in a thread of their own."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", nargs="+", type=int, default=[1000, 10_000])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--processor", action="store_true")
    options = parser.parse_args()
    bursts = {frames: record(frames) for frames in options.frames}
    # The first call of a thread decides how many threads work with it.
    with ThreadPoolExecutor(1) as caller:
        caller.submit(measure, options, bursts).result()


def measure(options: argparse.Namespace, bursts: dict[int, jl.Bits]) -> None:
    """Time all cases, and print the table."""
    clock, threads = (time.process_time, 1) if options.processor else (time.perf_counter, None)
    network = jl.pretrained(jl.Sensor())
    reconstruct = partial(network.reconstruct, threads=threads)
    first = bursts[options.frames[0]]
    counts, sensor = first[:WINDOW].counts(threads=threads), jl.Sensor(frames=WINDOW)
    jl.merge(first[:64], threads=threads)  # imports, and the file of the network
    of_network = best(lambda: reconstruct(counts, sensor), 3 * options.rounds, clock)
    print("| case | s | ratio |")
    print("| --- | ---: | ---: |")
    print(f"| network | {of_network:.4f} | 1 |", flush=True)
    for frames, bits in bursts.items():
        run = partial(lambda bits: reconstruct(jl.merge(bits, threads=threads)), bits)
        seconds = best(run, options.rounds, clock)
        print(f"| {frames:,} frames | {seconds:.3f} | {seconds / of_network:.1f} |", flush=True)
    images = film(first[: WINDOW + FILM_IMAGES * STEP], window=WINDOW, step=STEP, threads=threads)
    seconds = time_of_film(images, reconstruct, clock)
    print(f"| image of a film | {seconds:.3f} | {seconds / of_network:.1f} |")


def record(frames: int) -> jl.Bits:
    """Return the bits of a shaken camera, in memory."""
    scene = jl.datasets.moving(
        jl.datasets.photograph("camera").repeat(2, axis=1),
        "shake",
        sensor=jl.Sensor(frames=frames),
        shape=SIZE,
        photons=0.2,
        rng=0,
    )
    return jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)


def best(run: Callable[[], object], rounds: int, clock: Callable[[], float]) -> float:
    """Return the best time in seconds."""
    times = []
    for _ in range(rounds):
        start = clock()
        run()
        times.append(clock() - start)
    return min(times)


def time_of_film(
    images: Iterable[FilmImage],
    reconstruct: Callable[[jl.Merged], object],
    clock: Callable[[], float],
) -> float:
    """Return the best time of an image whose motion is carried, in seconds."""
    times = []
    start = clock()
    for image in images:
        reconstruct(image.merged)
        now = clock()
        if image.is_carried:
            times.append(now - start)
        start = now
    return min(times)


if __name__ == "__main__":
    main()
