"""Measure the images of films whose motion is carried from window to window.

    python benchmarks/studies/moving_films.py PHOTOGRAPHS [--images 8]

PHOTOGRAPHS is a folder. The scenes are made from its first two photographs, at 256 x 256 pixels,
with windows of 256 frames and steps of 16. The table shows the PSNR in dB without a border of 8
pixels, on the mean of the images to which the motion was carried, and their number.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.motion.films.film import film

WINDOW, STEP = 256, 16
SIZE = 256, 256
INNER = (slice(8, -8),) * 2
SCENES = (
    ("shake", 0.05),
    ("shake", 0.2),
    ("rotate", 0.2),
    ("fast", 0.2),
    ("spin", 0.2),
    ("layers", 0.05),
    ("layers", 0.2),
    ("sheet", 0.2),
)


def main() -> None:
    """Measure all scenes, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=8)
    options = parser.parse_args()
    photographs = read_image_set(options.photographs, first=3)[1]
    # A film that loses the motion estimates it afresh, and says so.
    warnings.simplefilter("ignore", jl.errors.JotlightWarning)
    print("| motion | photons | PSNR | carried |")
    print("| --- | ---: | ---: | ---: |")
    for motion, photons in SCENES:
        found = [
            value
            for first in (0, 1)
            for value in measure(motion, photons, photographs[first:], options.images)
        ]
        print(f"| {motion} | {photons} | {np.mean(found):.2f} | {len(found)} |", flush=True)


def measure(motion: str, photons: float, photographs: list[np.ndarray], images: int) -> list[float]:
    """Return the PSNR of each image of a film to which the motion was carried."""
    scene = jl.datasets.moving(
        photographs[0],
        motion,
        sensor=jl.Sensor(frames=WINDOW + images * STEP),
        foreground=photographs[1],
        shape=SIZE,
        photons=photons,
        rng=0,
    )
    bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)
    found = []
    for index, image in enumerate(film(bits, window=WINDOW, step=STEP)):
        if image.is_carried:
            truth = scene.image(index * STEP + WINDOW // 2)
            estimate = jl.pretrained(image.merged.sensor).reconstruct(image.merged)
            found.append(jl.metrics.psnr(estimate[INNER], truth[INNER], data_range=1.0))
    return found


if __name__ == "__main__":
    main()
