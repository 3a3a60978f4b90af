"""Compare films behind a Bayer mosaic with windows without motion.

    python benchmarks/studies/color_films.py PHOTOGRAPHS [--images 3] [--photons 0.05 0.2]

Each scene is a moving photograph in color behind RGGB, 384 frames of 192 x 256 pixels. The films
have windows of 128 frames and a step of 32. The table shows the mean PSNR in dB of all images of a
film, of the best of five windows around each of the same times (in causal films, before it), and of
a film that knows nothing of earlier windows; and how many images have a carried motion.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jotlight as jl
from jotlight.metrics import psnr
from jotlight.motion.films.film import film

FRAMES, SIZE = 384, (192, 256)
WINDOW, STEP = 128, 32
LENGTHS = 4, 8, 16, 32, 128
"""Frames of the windows without motion."""

Array = NDArray[np.float64]


def best_window(bits: jl.Bits, at: int, truth: Array, *, causal: bool) -> float:
    """Return the PSNR of the best window without motion, which knows the truth."""
    found = []
    for length in LENGTHS:
        start = at + 1 - length if causal else at - length // 2
        part = bits[max(0, start) : min(FRAMES, start + length)]
        found.append(psnr(jl.reconstruct(part), truth, data_range=1.0))
    return max(found)


def measure(scene: jl.datasets.MovingScene, *, causal: bool) -> list[float]:
    """Return the mean PSNR of the film, the windows, and a film without memory, and the share of
    the images whose motion is carried."""
    bits = jl.Bits(np.asarray(scene.bits.packed), SIZE[1], scene.sensor)
    rows = []
    films = [
        film(bits, window=WINDOW, step=STEP, causal=causal, memory=memory)
        for memory in (None, False)
    ]
    for number, (image, plain) in enumerate(zip(*films, strict=True)):
        at = number * STEP + round(image.motion.reference)
        truth = scene.image(at)
        values = [psnr(jl.reconstruct(each.data), truth, data_range=1.0) for each in (image, plain)]
        windows = best_window(bits, at, truth, causal=causal)
        rows.append([values[0], windows, values[1], float(image.is_carried)])
    return [float(value) for value in np.mean(rows, axis=0)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=3)
    parser.add_argument("--photons", nargs="+", type=float, default=[0.05, 0.2])
    parser.add_argument("--motions", nargs="+", default=["shake", "rotate", "layers", "static"])
    options = parser.parse_args()
    warnings.simplefilter("ignore", jl.JotlightWarning)
    files = sorted(options.photographs.iterdir())[: options.images]
    images = [jl.read_image(file).astype(np.float64) for file in files]
    print("| motion | photons | causal | film | best window | without memory | carried |")
    print("| --- | ---: | --- | ---: | ---: | ---: | ---: |")
    for motion in options.motions:
        for photons in options.photons:
            scenes = [
                jl.datasets.moving(
                    image,
                    motion,
                    sensor=jl.Sensor(frames=FRAMES, mosaic="RGGB"),
                    shape=SIZE,
                    photons=photons,
                    rng=seed,
                )
                for seed, image in enumerate(images)
            ]
            for causal in (False, True):
                rows = [measure(scene, causal=causal) for scene in scenes]
                found, windows, plain, carried = np.mean(rows, axis=0)
                print(
                    f"| {motion} | {photons:g} | {'yes' if causal else 'no'} | {found:.2f} | "
                    f"{windows:.2f} | {plain:.2f} | {carried:.0%} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
