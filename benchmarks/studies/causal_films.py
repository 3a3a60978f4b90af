"""Compare films that use only earlier frames with films that also use later ones.

    python benchmarks/studies/causal_films.py PHOTOGRAPHS [--images 3] [--frames 1024]
        [--window 256] [--step 64] [--photons 0.05 0.2 0.7] [--motions shake rotate fast layers]
        [--size 192]

The PSNR in dB is the mean over the same times: those of the images of the causal film that are also
those of the other film. Both have the same windows, and the network "medium" estimates all images,
without a border of 8 pixels. "window" is the best sum of up to 64 earlier frames without alignment,
chosen with the true image. "no memory" is the causal film without the bits from before its windows.
"recurrent" is the causal film with these bits, by the film network.

    python benchmarks/studies/causal_films.py PHOTOGRAPHS --time [--long 20000]

Measures the time and the memory of a live film of 256 x 512 jots: a shaking camera, whose frames
are repeated forward and backward. Each line is for an equal part of the images. Times are those of
the processor, on two threads: merging, the network for the merged counts, the film network, and the
network alone, for counts with the same number of trials everywhere. A ratio is the time
of merging and of a network, divided by that of the network alone. Images per second are those by
the film network.
"""

import argparse
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from borders import psnr_inside

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.motion.films.estimates import FilmEstimates, estimate_film
from jotlight.motion.films.film import film
from jotlight.motion.films.live_film import LiveFilm

Image = npt.NDArray[Any]

PARTS = 5
"""Number of lines of the table of time and memory."""


def main() -> None:
    """Print a row for each motion and exposure, or the time and the memory."""
    options = arguments()
    images = read_image_set(options.photographs, first=options.images + 1)[1]
    if options.time:
        measure_time(images[0], options)
        return
    titles = "window", "no memory", "causal", "gain", "recurrent", "gain", "with later frames"
    print(f"| motion | photons | {' | '.join(titles)} | carried |")
    print("| --- |" + " ---: |" * 9)
    for motion in options.motions:
        for photons in options.photons:
            rows = [
                measure(images[number : number + 2], motion, photons, number, options)
                for number in range(options.images)
            ]
            means = np.mean(rows, axis=0)
            window, without, causal, recurrent, later, carried = means
            print(
                f"| {motion} | {photons} | {window:.2f} | {without:.2f} | {causal:.2f} | "
                f"{causal - without:+.2f} | {recurrent:.2f} | {recurrent - without:+.2f} | "
                f"{later:.2f} | {carried:.0%} |",
                flush=True,
            )


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=3)
    parser.add_argument("--frames", type=int, default=1024)
    parser.add_argument("--window", type=int, default=256)
    parser.add_argument("--step", type=int, default=64)
    parser.add_argument("--photons", nargs="+", type=float, default=[0.05, 0.2, 0.7])
    parser.add_argument("--motions", nargs="+", default=["shake", "rotate", "fast", "layers"])
    parser.add_argument("--size", type=int, default=192)
    parser.add_argument("--time", action="store_true", help="measure the time and the memory")
    parser.add_argument("--long", type=int, default=20000, help="frames of the live film")
    return parser.parse_args()


def measure(
    images: list[Image], motion: str, photons: float, seed: int, options: argparse.Namespace
) -> list[float]:
    """Return the mean PSNR of the best window and of all films, and the share of carried images."""
    scene = jl.datasets.moving(
        images[0],
        motion,
        sensor=jl.Sensor(frames=options.frames),
        foreground=images[1],
        shape=(options.size, options.size),
        photons=photons,
        rng=seed,
    )
    bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)
    window, step = options.window, options.step
    spans = {"window": window, "step": step}
    without = list(film(bits, **spans, causal=True, memory=False))
    causal, later = list(film(bits, **spans, causal=True)), list(film(bits, **spans))
    recurrent = list(estimate_film(causal))
    # The causal image of a window shows its last frame, and the other one its middle.
    shift = window // 2 // step
    if window // 2 % step:
        raise ValueError("step: expected a divisor of half a window")
    rows = []
    for number, image in enumerate(causal[: len(later) - shift]):
        now = number * step + window - 1
        rows.append(
            [
                best_window(bits, scene.image(now), now),
                quality(without[number].merged, scene.image(now)),
                quality(image.merged, scene.image(now)),
                psnr_inside(recurrent[number], scene.image(now)),
                quality(later[number + shift].merged, scene.image(now + 1)),
                float(image.is_carried),
            ]
        )
    return list(np.mean(rows, axis=0))


def best_window(bits: jl.Bits, truth: Image, now: int) -> float:
    """Return the largest PSNR of sums of frames up to a time."""
    values = []
    for length in (1, 2, 4, 8, 16, 32, 64):
        part = bits[now + 1 - length : now + 1]
        sensor = bits.sensor.replace(frames=length)
        values.append(quality(jl.Merged(part.counts(), float(length), sensor), truth))
    return max(values)


def quality(merged: jl.Merged, truth: Image) -> float:
    """Return the PSNR in dB."""
    return psnr_inside(jl.pretrained(merged.sensor).reconstruct(merged), truth)


def measure_time(image: Image, options: argparse.Namespace) -> None:
    """Print the time and the memory of the images of a live film."""
    scene = jl.datasets.moving(
        image, "shake", sensor=jl.Sensor(frames=512), shape=(256, 512), photons=0.2, rng=0
    )
    packed = np.asarray(scene.bits.packed)
    there_and_back = np.concatenate([packed, packed[::-1]])
    sensor = scene.sensor.replace(frames=options.window)
    live = LiveFilm(sensor, window=options.window, step=options.step, threads=2)
    network = jl.pretrained(sensor)
    estimates = FilmEstimates(threads=2)
    rows: list[list[float]] = []
    fresh = 0
    tracemalloc.start()
    for start in range(0, options.long, options.step):
        places = np.arange(start, start + options.step) % len(there_and_back)
        times = [time.process_time()]
        found = live.add(jl.Bits(there_and_back[places], 512))
        times.append(time.process_time())
        for image in found:
            merged = image.merged
            runs: list[Callable[[], object]] = [
                partial(network.reconstruct, merged, threads=2),
                partial(estimates.add, image),
                # The same network, for counts with the same number of trials everywhere.
                partial(network.reconstruct, merged.ones, sensor, threads=2),
            ]
            for run in runs:
                run()
                times.append(time.process_time())
            rows.append([*np.diff(times), tracemalloc.get_traced_memory()[0] / 1e6])
            fresh += not image.is_carried
    print(f"{len(rows)} images, {fresh} of them estimated afresh")
    titles = "ms, merging", "ms, network", "ratio", "ms, film network", "ratio", "ms, alone"
    print(f"| images | {' | '.join(titles)} | images/s | MB |")
    print("| --- |" + " ---: |" * 8)
    for numbers in np.array_split(np.arange(len(rows)), PARTS):
        merging, of_network, of_film, alone, memory = np.mean(np.array(rows)[numbers], axis=0)
        print(
            f"| {numbers[0]} to {numbers[-1]} | {1000 * merging:.0f} | {1000 * of_network:.0f} | "
            f"{(merging + of_network) / alone:.1f} | {1000 * of_film:.0f} | "
            f"{(merging + of_film) / alone:.1f} | {1000 * alone:.0f} | "
            f"{1 / (merging + of_film):.1f} | {memory:.1f} |"
        )


if __name__ == "__main__":
    main()
