"""Compare the frames that `jotlight plan --speed` proposes with simulated scenes at these speeds.

    python benchmarks/studies/planned_motion.py PHOTOGRAPHS [--images 3] [--frames 512]
        [--photons 0.05 0.2 0.7] [--speeds 0.03 0.1 0.3 1] [--size 128]

The first photographs of a folder, in the order of their names, move at a constant speed. The table
shows means over them. The network "medium" estimates all images, and the PSNR in dB is that of the
middle frame, without a border of 8 pixels.

- best sum: the number of frames among the powers of √2 whose sum is best, chosen with the true
  image; the geometric mean.
- planned sum: the number that the plan proposes, which knows the light and the speed alone.
- loss: by how much the sum of the planned number is worse than the best sum; the mean and the
  largest value.
- aligned: `jotlight.merge` of 64 frames, of a quarter of the frames, and of all.
- planned: the PSNR of the plan for these numbers, and that for all frames minus that for 64.
- error: the root mean square of the errors of the displacements in pixels, of all frames, and the
  planned one.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from borders import INNER, psnr_inside

import jotlight as jl
from jotlight.images.sets import read_image_set

Image = npt.NDArray[Any]


def main() -> None:
    """Print a row for each exposure and speed."""
    options = arguments()
    images = read_image_set(options.photographs, first=options.images)[1]
    print(
        "| photons | speed | best sum | planned sum | loss | aligned | planned | error | planned |"
    )
    print("| ---: | ---: | ---: | ---: | ---: | --- | --- | ---: | ---: |")
    for photons in options.photons:
        for speed in options.speeds:
            rows = [
                measure(image, photons, speed, options.frames, options.size, seed)
                for seed, image in enumerate(images)
            ]
            print_row(photons, speed, rows)


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=3)
    parser.add_argument("--frames", type=int, default=512)
    parser.add_argument("--photons", nargs="+", type=float, default=[0.05, 0.2, 0.7])
    parser.add_argument("--speeds", nargs="+", type=float, default=[0.03, 0.1, 0.3, 1.0])
    parser.add_argument("--size", type=int, default=128, help="rows and columns of the sensor")
    return parser.parse_args()


def measure(
    image: Image, photons: float, speed: float, frames: int, size: int, seed: int
) -> dict[str, Any]:
    """Return what is found in a scene."""
    direction = np.random.default_rng(seed).uniform(0, 2 * np.pi)
    path = speed * (np.arange(frames) - frames // 2)
    shifts = np.outer(path, (np.sin(direction), np.cos(direction)))
    scene = jl.datasets.moving(
        image,
        shifts,
        sensor=jl.Sensor(frames=frames),
        shape=(size, size),
        photons=photons,
        rng=seed,
    )
    bits = jl.Bits(np.asarray(scene.bits.packed), size, scene.sensor)
    truth = scene.image()
    numbers = [64, frames // 4, frames]
    # The plan assumes light between 0 and a maximum, which is 1 here.
    largest = scene.sensor.light_per_intensity
    plan = jl.plan(
        scene.sensor,
        (0.05 * largest, largest),
        frames=numbers,
        speed=speed,
        size=(size, size),
    ).motion
    sums = {length: sum_quality(bits, length, truth) for length in lengths(frames)}
    best = max(sums, key=lambda length: sums[length])
    planned = sum_quality(bits, min(frames, plan.best_sum), truth)
    parts = [centered(bits, number) for number in numbers]
    motions = [jl.align(part) for part in parts]
    aligned = [
        psnr_inside(jl.pretrained(part.sensor).reconstruct(jl.merge(part, motion=motion)), truth)
        for part, motion in zip(parts, motions, strict=True)
    ]
    errors = [
        motions[-1].at(time)[(slice(None), *INNER)].mean(axis=(1, 2)) - shifts[time]
        for time in range(0, frames, 8)
    ]
    return {
        "best": best,
        "planned": plan.best_sum,
        "loss": sums[best] - planned,
        "aligned": aligned,
        "expected": plan.aligned,
        "error": float(np.sqrt(np.mean(np.square(errors)))),
        "expected_error": plan.registration_error,
    }


def lengths(frames: int) -> list[int]:
    """Return the powers of √2 up to a number of frames."""
    powers = [round(2 ** (n / 2)) for n in range(2 * frames.bit_length())]
    return sorted({1, *(power for power in powers if power <= frames)})


def centered(bits: jl.Bits, length: int) -> jl.Bits:
    """Return the frames around the middle one, with their sensor."""
    start = len(bits) // 2 - length // 2
    part = bits[start : start + length]
    return jl.Bits(part.packed, part.width, bits.sensor.replace(frames=length))


def sum_quality(bits: jl.Bits, length: int, truth: Image) -> float:
    """Return the PSNR of a sum of frames without alignment."""
    part = centered(bits, length)
    merged = jl.Merged(part.counts(), float(length), part.sensor)
    return psnr_inside(jl.pretrained(part.sensor).reconstruct(merged), truth)


def print_row(photons: float, speed: float, rows: list[dict[str, Any]]) -> None:
    """Print the means of several scenes."""

    def mean(name: str) -> Any:
        return np.mean([row[name] for row in rows], axis=0)

    best, planned = (
        np.exp(np.mean([np.log(row[name]) for row in rows])) for name in ("best", "planned")
    )
    losses = [row["loss"] for row in rows]
    aligned, expected = mean("aligned"), mean("expected")
    print(
        f"| {photons} | {speed} | {best:.0f} | {planned:.0f} | {np.mean(losses):.2f}, "
        f"{max(losses):.2f} | {', '.join(f'{each:.1f}' for each in aligned)} "
        f"({aligned[-1] - aligned[0]:+.1f}) | {', '.join(f'{each:.1f}' for each in expected)} "
        f"({expected[-1] - expected[0]:+.1f}) | {mean('error'):.2f} | "
        f"{mean('expected_error'):.2f} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
