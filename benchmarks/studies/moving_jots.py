"""Measure what it costs to ignore the differences between jots in the alignment.

    python benchmarks/studies/moving_jots.py PHOTOGRAPHS [--images 3] [--frames 256]
        [--photons 0.2] [--motion shake]

PHOTOGRAPHS is a folder. Its first images in the order of their names are recorded with 256 x 256
jots by sensors of these kinds:

- perfect: all jots detect all photons, without dark counts.
- vignetting: the efficiency falls to 50 % in the corners.
- hot jots: 1 % of the jots have 0.5 to 2 dark counts per frame.
- dark counts: on average as many as photons, with a gamma distribution of shape 2 over the jots.
- fixed pattern: the efficiency of a jot is 0.7, with a standard deviation of 10 %.
- all: all of these together.

The table shows the error of the motion, a root mean square over all jots and 24 times in pixels,
and the PSNR in dB without a border of 8 pixels. Both are means over the images. "Ignored" aligns
the bits as if all jots were alike, except hot ones, which it leaves out. "Known" is `jl.align`. All
images are merged and reconstructed with the maps of the sensor. "Equal jots" is a sensor all of
whose jots have the mean efficiency and the mean dark counts, except those of hot jots. Seconds are
those of the processor for `jl.align`, with jots that are ignored and known.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from borders import psnr_inside

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.motion.counts.sensor_blocks import hot_jots

SIZE = 256, 256
TIMES = 24
HEADS = "ignored", "known", "equal jots"

Maps = dict[str, Any]


def main() -> None:
    """Measure all kinds of sensors, and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=3)
    parser.add_argument("--frames", type=int, default=256)
    parser.add_argument("--photons", type=float, default=0.2)
    parser.add_argument("--motion", default="shake")
    options = parser.parse_args()
    _, images = read_image_set(options.photographs, first=options.images)
    errors = " | ".join(f"error, {head}" for head in HEADS)
    quality = " | ".join(f"PSNR, {head}" for head in HEADS)
    print(f"| sensor | {errors} | {quality} | seconds |")
    print(f"| --- |{' ---: |' * 7}")
    for kind, (maps, means) in kinds(options.photons).items():
        found = []
        for seed, image in enumerate(images):
            arguments = image, options.motion, options.frames, options.photons, seed
            found.append([*measure(maps, *arguments), *measure(means, *arguments)[-3:]])
        ignored, known, equal = np.mean(found, axis=0).reshape(3, 3)
        rows = ignored, known, equal
        cells = [f"{row[0]:.2f}" for row in rows] + [f"{row[1]:.2f}" for row in rows]
        cells.append(f"{ignored[2]:.1f}, {known[2]:.1f}")
        print(f"| {kind} | {' | '.join(cells)} |", flush=True)


def kinds(photons: float) -> dict[str, tuple[Maps, Maps]]:
    """Return the maps of each kind of sensor, and those of equal jots."""
    rng = np.random.default_rng(7)
    rows, columns = (np.linspace(-1, 1, length) for length in SIZE)
    vignetting = 1 - 0.25 * (rows[:, None] ** 2 + columns**2)
    hot = np.where(rng.random(SIZE) < 0.01, rng.uniform(0.5, 2, SIZE), 0)
    dark = photons * rng.gamma(2, 0.5, SIZE)
    fixed = np.clip(rng.normal(0.7, 0.07, SIZE), 0.01, 1)
    every = vignetting * fixed
    return {
        "perfect": ({}, {}),
        "vignetting": ({"efficiency": vignetting}, {"efficiency": vignetting.mean()}),
        "hot jots": ({"dark_counts": hot}, {}),
        "dark counts": ({"dark_counts": dark}, {"dark_counts": dark.mean()}),
        "fixed pattern": ({"efficiency": fixed}, {"efficiency": fixed.mean()}),
        "all": (
            {"efficiency": every, "dark_counts": dark + hot},
            {"efficiency": every.mean(), "dark_counts": dark.mean()},
        ),
    }


def measure(
    maps: Maps,
    image: npt.NDArray[np.float32],
    motion: str,
    frames: int,
    photons: float,
    seed: int,
) -> list[float]:
    """Return the error, the PSNR, and the seconds, with jots that are ignored and known."""
    sensor = jl.Sensor(frames=frames, **maps)
    scene = jl.datasets.moving(image, motion, sensor=sensor, shape=SIZE, photons=photons, rng=seed)
    bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)
    truth, network = scene.image(), jl.pretrained(scene.sensor)
    hot = hot_jots(scene.sensor)
    alike = scene.sensor.replace(efficiency=1.0, dark_counts=0.0, mask=hot)
    numbers = []
    for aligned_with in (alike, scene.sensor):
        start = time.process_time()
        found = jl.align(bits, aligned_with, threads=1)
        seconds = time.process_time() - start
        estimate = network.reconstruct(jl.merge(bits, motion=found, threads=1))
        squares = [
            ((found.at(moment) - scene.motion(moment)) ** 2).sum(axis=0).mean()
            for moment in np.linspace(0, frames - 1, TIMES)
        ]
        error = float(np.sqrt(np.mean(squares)))
        numbers += [error, psnr_inside(estimate, truth), seconds]
    return numbers


if __name__ == "__main__":
    main()
