"""Measure how reliably jotlight finds color filter mosaics and hot jots in captures of scenes.

    python benchmarks/studies/scene_checks.py PHOTOGRAPHS [PHOTOGRAPHS …] [--every 1]

Each PHOTOGRAPHS is a folder. The first table is for photographs as a gray sensor, a Bayer mosaic,
and a quad Bayer mosaic capture them: the captures with periodic rates, and the range of the scores.

The second table is for hot jots. Of all jots, 0.5 % have 0.01 to 3 dark counts per frame,
log-uniformly distributed. "Strong" are those with more than 6 times the light of the scene. False
positives are counted in captures without hot jots, too.
"""

import argparse
import itertools
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.calibration.hot_jots import find_hot_jots
from jotlight.images.io import read_image
from jotlight.images.sets import ENDINGS
from jotlight.sensing.data.periodic_rates import find_periodic_rates

PHOTONS = 0.05, 0.7
"""Mean photons per jot and frame."""

FRAMES = 1, 16, 256, 4096
HOT_FRAMES = 64, 256, 2000
HOT_SHARE, DARK_COUNTS, STRONG = 0.005, (0.01, 3.0), 6.0
LUMA = 0.299, 0.587, 0.114

Image = npt.NDArray[np.floating]


def main() -> None:
    """Measure, and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=1, help="use every n-th photograph")
    options = parser.parse_args()
    files = [file for folder in options.photographs for file in sorted(folder.iterdir())]
    files = [file for file in files if file.suffix.lower() in ENDINGS]
    measure_mosaics(files[:: options.every])
    measure_hot_jots(files[:: options.every])


def measure_mosaics(files: list[Path]) -> None:
    """Print the captures in which periodic rates are found."""
    found: dict[tuple[str, int, float], list[int]] = {}
    rng = np.random.default_rng(0)
    for colors in map(read_colors, files):
        scenes = {
            "gray": colors @ LUMA,
            "Bayer": mosaic(colors, 1),
            "quad Bayer": mosaic(colors, 2),
        }
        for (name, scene), frames, photons in itertools.product(scenes.items(), FRAMES, PHOTONS):
            counts = expose(rng, photons * scene / scene.mean(), frames)
            periodic = find_periodic_rates(counts)
            period = 0 if periodic is None else periodic.period
            found.setdefault((name, frames, photons), []).append(period)
    print("| sensor | frames | photons | captures | period 2 | period 4 |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for (name, frames, photons), periods in found.items():
        numbers = f"{len(periods)} | {periods.count(2)} | {periods.count(4)}"
        print(f"| {name} | {frames} | {photons} | {numbers} |", flush=True)


def measure_hot_jots(files: list[Path]) -> None:
    """Print how many hot jots are found, and how many others."""
    rng = np.random.default_rng(0)
    sums: dict[tuple[int, float], npt.NDArray[np.int64]] = {}
    for scene in (colors @ LUMA for colors in map(read_colors, files)):
        for frames, photons in itertools.product(HOT_FRAMES, PHOTONS):
            light = photons * scene / scene.mean()
            total = sums.setdefault((frames, photons), np.zeros(7, np.int64))
            total += hot_jot_numbers(rng, light, frames)
    print(
        "\n| frames | photons | false, without hot jots | precision | recall | recall of strong |"
    )
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for (frames, photons), (jots, false, hot, right, called, strong, strong_right) in sums.items():
        print(
            f"| {frames} | {photons} | {false} of {jots / 1e6:.1f} million | {right / called:.2%} "
            f"| {right / hot:.1%} | {strong_right / strong:.1%} |",
            flush=True,
        )


def hot_jot_numbers(rng: np.random.Generator, light: Image, frames: int) -> npt.NDArray[np.int64]:
    """Return the numbers that the second table sums over the photographs."""
    clean = find_hot_jots(expose(rng, light, frames), trials=frames)
    hot = rng.random(light.shape) < HOT_SHARE
    low, high = np.log(DARK_COUNTS)
    dark_counts = np.where(hot, np.exp(rng.uniform(low, high, light.shape)), 0)
    found = find_hot_jots(expose(rng, light + dark_counts, frames), trials=frames)
    strong = dark_counts > STRONG * light
    return np.array(
        [
            light.size,
            clean.sum(),
            hot.sum(),
            (found & hot).sum(),
            found.sum(),
            strong.sum(),
            (found & strong).sum(),
        ]
    )


def read_colors(file: Path) -> Image:
    """Return a photograph as (H, W, 3)."""
    image = read_image(file).astype(np.float64)
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


def mosaic(colors: Image, side: int) -> Image:
    """Return what jots under red, green, green, and blue squares of `side` jots see."""
    rows, columns = (np.arange(length) // side % 2 for length in colors.shape[:2])
    channel = rows[:, None] + columns
    return np.take_along_axis(colors, channel[..., None], axis=2)[..., 0]


def expose(rng: np.random.Generator, light: Image, frames: int) -> npt.NDArray[np.int32]:
    """Return counts of the ones of each jot."""
    return rng.binomial(frames, -np.expm1(-light)).astype(np.int32)


if __name__ == "__main__":
    main()
