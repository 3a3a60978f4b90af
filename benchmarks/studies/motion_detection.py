"""Measure how reliably jotlight detects that a scene moves, and how often it errs.

    python benchmarks/studies/motion_detection.py PHOTOGRAPHS [--scenes 1000] [--images 4]

PHOTOGRAPHS is a folder. The first table is for static scenes of random photographs, sizes,
exposures, and numbers of frames: the largest score and the number of false alarms.

- steady: nothing changes.
- flicker: the light changes by up to ±30 % between groups of frames, by other amounts in other
  columns.
- hot jots: 2 % of the jots have up to one dark count per frame.
- afterpulsing: each 1 causes a 1 in the next frame with a probability of 5 %.

The second table is for moving scenes of 256 x 256 jots: the smallest score, and the number of
scenes that are detected.
"""

import argparse
import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.motion.counts.detection import THRESHOLD, motion_score

SIZES = 64, 100, 200, 320
FRAMES = 16, 64, 256, 1000
PHOTONS = 0.02, 0.05, 0.2, 0.7, 2.0
MOVING_PHOTONS = 0.05, 0.2, 0.7
MOVING_FRAMES = 64, 256, 1000
MOTIONS = "shake", "rotate", "layers"
FLICKERING_GROUPS = 8

Image = npt.NDArray[np.floating]


def main() -> None:
    """Measure, and print both tables."""
    options = arguments()
    _, images = read_image_set(options.photographs, first=10)
    print("| static | scenes | largest score | false alarms |")
    print("| --- | ---: | ---: | ---: |")
    for kind in ("steady", "flicker", "hot jots", "afterpulsing"):
        scores = [
            motion_score(bits)
            for bits in itertools.islice(static_bits(images, kind), options.scenes)
        ]
        alarms = sum(score > THRESHOLD for score in scores)
        print(f"| {kind} | {len(scores)} | {max(scores):.1f} | {alarms} |", flush=True)
    print("\n| motion | frames | photons | smallest score | detected |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for motion, frames, photons in itertools.product(MOTIONS, MOVING_FRAMES, MOVING_PHOTONS):
        scores = [
            motion_score(moving_bits(images, index, motion, frames, photons))
            for index in range(options.images)
        ]
        detected = f"{sum(score > THRESHOLD for score in scores)} of {len(scores)}"
        print(f"| {motion} | {frames} | {photons} | {min(scores):.1f} | {detected} |", flush=True)


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--images", type=int, default=4)
    return parser.parse_args()


def static_bits(images: list[Image], kind: str) -> Iterator[jl.Bits]:
    """Yield the bits of random static scenes."""
    rng = np.random.default_rng(0)
    while True:
        size, frames, photons = (rng.choice(values) for values in (SIZES, FRAMES, PHOTONS))
        image = images[rng.integers(len(images))]
        row, column = (rng.integers(length - size + 1) for length in image.shape)
        patch = image[row : row + size, column : column + size]
        dark = np.zeros(patch.shape)
        if kind == "hot jots":
            dark = rng.random(patch.shape) * (rng.random(patch.shape) < 0.02)
        sensor = jl.Sensor(frames=1, gain=photons / max(patch.mean(), 1e-3), dark_counts=dark)
        groups = FLICKERING_GROUPS if kind == "flicker" else 1
        parts = []
        for group in range(groups):
            length = len(range(group, frames, groups))
            factors = 1 + 0.3 * rng.uniform(-1, 1, 2) * (groups > 1)
            light = patch * np.linspace(*factors, max(SIZES))[:size]
            exposure = sensor.replace(frames=length)
            parts.append(exposure.expose(light, rng).packed)
        packed = np.concatenate(parts)
        if kind == "afterpulsing":
            numbers = rng.integers(0, 256, (frames - 1, size, size), np.uint8)
            pulses = np.packbits(numbers < 0.05 * 256, axis=2)
            packed[1:] |= packed[:-1] & pulses
        yield jl.Bits(packed, size)


def moving_bits(
    images: list[Image], index: int, motion: str, frames: int, photons: float
) -> jl.Bits:
    """Return the bits of a moving scene."""
    scene = jl.datasets.moving(
        images[index],
        motion,
        sensor=jl.Sensor(frames=frames),
        foreground=images[index + 1],
        shape=(256, 256),
        photons=photons,
        rng=index,
    )
    return jl.Bits(np.asarray(scene.bits.packed), scene.bits.width)


if __name__ == "__main__":
    main()
