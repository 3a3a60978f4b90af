"""Measure the methods for colors with many trials per pixel.

    python benchmarks/studies/color_trials.py PHOTOGRAPHS [--images 6]

PHOTOGRAPHS is a folder. The study takes the central 192 x 192 pixels of its first color images in
the order of their names, as three channels and behind RGGB, with one photon or 0.05 photons per jot
and frame at intensity 1. The table shows the PSNR in dB, averaged over the images:

- gray: the blend on held-out bits for each channel, or for each plane with Menon's method.
- color network: the color network alone.
- held-out: the blend of both, which is the default above 1,000 trials.
- worst: held-out minus the better one of the two others, for the image where it is smallest.

The study takes ten minutes on two cores, and needs the extra `color`.
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.networks.pretrained import CHANNELS_FILE, pretrained_color

SIDE = 192
ALL_TRIALS = 256, 1000, 2000, 4000, 10_000, 30_000, 100_000
COLUMNS = "gray", "color network", "held-out"

Image = npt.NDArray[np.floating]


def main() -> None:
    """Print a table for channels, and one for a mosaic."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=6)
    options = parser.parse_args()
    images = [center(path) for path in sorted(options.photographs.iterdir())[: options.images]]
    for title, measure in (("three channels", channels), ("RGGB", mosaic)):
        print(f"{title}\n\n| photons | K | {' | '.join(COLUMNS)} | worst |")
        print(f"| ---: |{' ---: |' * (len(COLUMNS) + 2)}")
        for photons in (1.0, 0.05):
            for trials in ALL_TRIALS:
                sensor = jl.Sensor(frames=trials, gain=trials * photons)
                rows = np.array([measure(image, sensor, seed) for seed, image in enumerate(images)])
                worst = (rows[:, 2] - rows[:, :2].max(axis=1)).min()
                means = " | ".join(f"{mean:.2f}" for mean in rows.mean(axis=0))
                print(f"| {photons:g} | {trials:,} | {means} | {worst:+.2f} |", flush=True)
        print()


def center(path: Path) -> Image:
    """Return the middle of a photograph."""
    image = np.asarray(jl.read_image(path), np.float64)
    top, left = ((size - SIDE) // 2 for size in image.shape[:2])
    return image[top : top + SIDE, left : left + SIDE]


def channels(image: Image, sensor: jl.Sensor, seed: int) -> list[float]:
    """Return the PSNR of each method for three counts per pixel."""
    probability = sensor.probability(image, channel_axis=-1).astype(float)
    counts = np.random.default_rng(seed).binomial(sensor.frames, probability).astype(np.int32)
    planes = np.ascontiguousarray(np.moveaxis(counts, -1, 0))
    gray = np.moveaxis(jl.reconstruct(planes, sensor, method="held-out"), 0, -1)
    network = pretrained_color(CHANNELS_FILE)
    alone, blend = (
        jl.reconstruct(counts, sensor, method=method, channel_axis=-1)
        for method in (network, "held-out")
    )
    return [float(jl.metrics.psnr(each, image)) for each in (gray, alone, blend)]


def mosaic(image: Image, sensor: jl.Sensor, seed: int) -> list[float]:
    """Return the PSNR of each method behind RGGB."""
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]] % 2
    seen = np.take_along_axis(image, (rows + columns)[..., None], axis=2)[..., 0]
    probability = sensor.probability(seen).astype(float)
    counts = np.random.default_rng(seed).binomial(sensor.frames, probability).astype(np.int32)
    own = sensor.replace(mosaic="RGGB")
    settings = (
        {"quality": "medium", "fallback": True, "demosaicing": "menon"},
        {"demosaicing": "network"},
        {"method": "held-out"},
    )
    found = [jl.reconstruct(counts, own, **each) for each in settings]
    return [float(jl.metrics.psnr(each, image)) for each in found]


if __name__ == "__main__":
    main()
