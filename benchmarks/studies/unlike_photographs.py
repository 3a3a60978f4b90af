"""Compare methods on scenes that are unlike photographs, and show how they are flagged.

    python benchmarks/studies/unlike_photographs.py [--trials 4 16 64 256]

The table shows the PSNR in dB, and the fraction of pixels that `jotlight.uncertainty` flags as
unlikely under the estimate of "medium". The scenes have 256 x 256 pixels, 1 photon per jot and
frame at intensity 1, and random numbers from a fixed seed.
"""

import argparse
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter

import jotlight as jl

SIDE = 256
METHODS: dict[str, dict[str, Any]] = {
    "medium": {},
    "with fallback": {"fallback": True},
    "admm-tv": {"method": "admm-tv"},
    "noniterative-tv": {"method": "noniterative-tv"},
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", nargs="+", type=int, default=[4, 16, 64, 256])
    options = parser.parse_args()
    print(f"| scene | K | {' | '.join(METHODS)} | unlikely |")
    print(f"| --- | ---: | {' | '.join('---:' for _ in METHODS)} | ---: |")
    for name, image in scenes().items():
        for trials in options.trials:
            bits = jl.Sensor(frames=trials).expose(image, rng=1)
            scores = [
                jl.metrics.psnr(jl.reconstruct(bits, **options), image)
                for options in METHODS.values()
            ]
            unlikely = jl.uncertainty(bits, method="network-medium").unlikely.mean()
            columns = [f"{score:.2f}" for score in scores]
            print(f"| {name} | {trials} | {' | '.join(columns)} | {unlikely:.0%} |", flush=True)


def scenes() -> dict[str, npt.NDArray[np.float64]]:
    """Return the scenes by name."""
    rng = np.random.default_rng(0)
    row, column = np.mgrid[:SIDE, :SIDE]
    blurred = gaussian_filter(rng.normal(size=(SIDE, SIDE)), 1.5)
    return {
        "white noise": rng.uniform(0.1, 0.9, (SIDE, SIDE)),
        "smooth noise": np.clip(0.5 + 1.5 * blurred, 0, 1),
        "checkerboard, 1 pixel": 0.1 + 0.8 * ((row + column) % 2),
        "checkerboard, 4 pixels": 0.1 + 0.8 * ((row // 4 + column // 4) % 2),
        "saturated panels": np.where((row // 64 + column // 64) % 2, 1.0, 0.02),
        "stripes, 3.3 pixels": 0.5 + 0.4 * np.sin(2 * np.pi * column / 3.3),
        "points": np.where(rng.random((SIDE, SIDE)) < 0.02, 1.0, 0.05),
        "text": text(),
        "fluorescent cells": cells(rng),
    }


def text() -> npt.NDArray[np.float64]:
    """Return lines of dark text on a bright page."""
    page = Image.new("L", (SIDE, SIDE), 230)
    draw = ImageDraw.Draw(page)
    for line in range(SIDE // 14):
        draw.text((4, 14 * line), "Photons arrive one by one, and each jot counts a few. " * 2, 20)
    return np.asarray(page, np.float64) / 255


def cells(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return bright round cells with spots, blurred, on a dark background, like a microscope's."""
    row, column = np.mgrid[:SIDE, :SIDE]
    image = np.full((SIDE, SIDE), 0.01)
    for y, x, radius in zip(
        rng.uniform(0, SIDE, 25), rng.uniform(0, SIDE, 25), rng.uniform(8, 16, 25), strict=True
    ):
        image += 0.15 * ((row - y) ** 2 + (column - x) ** 2 < radius**2)
    image += 8 * (rng.random((SIDE, SIDE)) < 0.004) * (image > 0.1)
    return np.clip(gaussian_filter(image, 1.3), 0, 1)


if __name__ == "__main__":
    main()
