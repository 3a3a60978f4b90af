"""Shift the frames of a real capture by known numbers of pixels, and find the shifts.

    python benchmarks/studies/shifted_capture.py COUNTS [--seeds 3]

COUNTS is a .npz file with nested counts of ones of a static scene: k1, k4, k16, and k64, (H, W),
over 1, 4, 16, and 64 frames. From these, 16 binary frames are drawn at random, so that their sums
are the real ones. The frames are cropped at places that move by whole pixels. The table shows the
model that the alignment chooses, the largest error of the displacements in pixels, and the PSNR of
the image against the other 48 frames. These are noisy, too, so the PSNR is low. The first row is
about the scene that stands still.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl

MARGIN = 32
"""Width of the border that is cropped, so that frames can be shifted, in pixels."""

INNER = (slice(24, -24),) * 2

Shifts = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]

PATHS: dict[str, Shifts] = {
    "none": lambda times: 0 * np.stack([times, times]),
    "1 px per frame": lambda times: np.stack([times, -times]),
    "2 px per frame": lambda times: np.stack([0 * times, 2 * times]),
    "curve": lambda times: np.stack([times**2 / 8, 8 * np.sin(times / 4)]),
}
"""Displacements at times relative to the middle, (2, n). They are rounded."""


def main() -> None:
    """Print a row for each path and seed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("counts", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    with np.load(options.counts, allow_pickle=False) as file:
        counts = {name: file[name].astype(np.int64) for name in ("k1", "k4", "k16", "k64")}
    target = np.clip(counts["k64"] - counts["k16"], 0, 48) / 48
    print("| path | seed | model | largest error | PSNR |")
    print("| --- | ---: | --- | ---: | ---: |")
    for name, path in PATHS.items():
        for seed in range(options.seeds):
            frames = draw_frames(counts, np.random.default_rng(seed))
            model, error, quality = measure(frames, target, path)
            print(f"| {name} | {seed} | {model} | {error:.2f} | {quality:.2f} |", flush=True)


def draw_frames(
    counts: dict[str, npt.NDArray[np.int64]], rng: np.random.Generator
) -> npt.NDArray[np.bool_]:
    """Return 16 random binary frames with the given sums, (16, H, W)."""
    parts = [counts["k1"], counts["k4"] - counts["k1"], counts["k16"] - counts["k4"]]
    frames = []
    for ones, number in zip(parts, (1, 3, 12), strict=True):
        rank = rng.random((number, *ones.shape)).argsort(axis=0).argsort(axis=0)
        frames.append(rank < ones)
    return np.concatenate(frames)


def measure(
    frames: npt.NDArray[np.bool_], target: npt.NDArray[np.float64], path: Shifts
) -> tuple[str, float, float]:
    """Return the model, the largest error in pixels, and the PSNR of the image in dB."""
    height, width = (length - 2 * MARGIN for length in target.shape)
    shifts = np.rint(path(np.arange(16.0) - 8)).astype(int)
    cropped = np.stack(
        [
            frame[MARGIN - row : MARGIN - row + height, MARGIN - column : MARGIN - column + width]
            for frame, row, column in zip(frames, *shifts, strict=True)
        ]
    )
    bits = jl.Bits.from_array(cropped, jl.Sensor(frames=16))
    motion = jl.align(bits)
    errors = [motion.at(time) - shifts[:, time, None, None] for time in range(16)]
    merged = jl.merge(bits, motion=motion)
    image = jl.pretrained(bits.sensor).reconstruct(merged)
    # The intensity of bits with a gain of 16 photons in 16 frames is the mean number of photons.
    fraction = 1 - np.exp(-image)
    here = target[MARGIN : MARGIN + height, MARGIN : MARGIN + width]
    quality = jl.metrics.psnr(fraction[INNER], here[INNER], data_range=1.0)
    return motion.model, float(np.max([abs(error).max() for error in errors])), quality


if __name__ == "__main__":
    main()
