"""Measure the errors of the color network behind mosaics, for `jotlight.uncertainty`.

    python tools/calibrate_color_intervals.py path/to/data

As in ``calibrate_intervals``, training photographs determine the scale of the errors, and
validation photographs the quantiles of error/scale. The mosaics are those that train the network.
The result goes to ``python/jotlight/evaluation/intervals/color_error_scale.json``. It takes ten
minutes on one core.
"""

import argparse
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jotlight as jl
import training_data
from calibrate_intervals import (
    CLASSES,
    GAMMA,
    LINEAR_FRACTION,
    PHOTONS,
    Errors,
    fit_weights,
    start_model,
    tabulate,
)
from jotlight.evaluation.intervals.color_intervals import MosaicPixels
from jotlight.evaluation.intervals.error_scale import COLOR_FILE, error_model, error_terms
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.training import random_mosaic

TRIALS = 1, 2, 4, 9, 16, 36, 64, 256, 1000
FOLDERS = "photographs/cid22", "photographs/clic2025", "bsds500_extra"
PHOTOGRAPHS, SIDE = 30, 160
"""Maximum number of photographs of each folder, and the side of their central parts."""

IMAGES, PIXELS = 3, 800
"""Number of photographs for each K and exposure, and of pixels of each color."""

Scene = tuple[MosaicPixels, NDArray[np.float64]]
"""The data of an image, and its exact colors (H, W, 3)."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore", jl.JotlightWarning)
    rng = np.random.default_rng(0)
    files = [training_data.training_files(options.data, folder) for folder in FOLDERS]
    weights = fit_weights(*training_errors(central_parts(files, rng), rng))
    model = start_model(weights)
    images = central_parts([training_data.validation_files(options.data)], rng)
    for _ in range(2):
        model.write(COLOR_FILE)
        error_model.cache_clear()
        ratios, ones = validation_errors(images, rng)
        # The colors have no classes of activity, and all of their pixels count alike.
        activity, alike = np.zeros(len(ones)), np.ones(len(ones))
        model = tabulate(weights, ratios, ones, activity, alike, (CLASSES[0], 1))
    model.write(COLOR_FILE)


def central_parts(
    files: Sequence[Sequence[Path]], rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Return the central parts of some color photographs of each list."""
    images = []
    for paths in files:
        for index in rng.choice(len(paths), min(len(paths), PHOTOGRAPHS), replace=False):
            image = jl.read_image(paths[index]).astype(np.float64)
            if image.ndim == 3:
                top, left = (max(0, (size - SIDE) // 2) for size in image.shape[:2])
                images.append(image[top : top + SIDE, left : left + SIDE])
    return images


def scenes(images: list[NDArray[np.float64]], rng: np.random.Generator) -> Iterator[Scene]:
    """Yield photographs behind random mosaics at all K and exposures."""
    for trials in TRIALS:
        for photons in PHOTONS:
            for index in rng.choice(len(images), IMAGES, replace=False):
                image = images[index]
                if rng.random() < LINEAR_FRACTION:
                    image = image**GAMMA
                mosaic = random_mosaic(rng, max(image.shape))
                mosaic = mosaic.crop(range(image.shape[0]), range(image.shape[1]))
                sensor = jl.Sensor(frames=trials, gain=photons * trials, mosaic=mosaic)
                bits = sensor.expose(image, rng=int(rng.integers(1 << 30)), channel_axis=-1)
                gray = without_mosaic(sensor)
                counted = count_pixels(bits.counts(), gray, 1)
                yield MosaicPixels.of(counted, mosaic, threads=1), image


def training_errors(images: list[NDArray[np.float64]], rng: np.random.Generator) -> Errors:
    """Return errors of some pixels and colors, and the terms of their scale."""
    errors, terms = [], []
    for pixels, truth in scenes(images, rng):
        colors = pixels.estimate()
        for color, share in enumerate(pixels.shares):
            gray = pixels.colors_of(color)
            z, exact = (gray.stabilize(each[..., color]) for each in (colors, truth))
            chosen = rng.choice(z.size, PIXELS, replace=False)
            errors.append((exact - z).flat[chosen])
            of_color = error_terms(z, np.maximum(gray.trials, 0.5), share)
            terms.append(np.stack([term.flat[chosen] for term in of_color], axis=1))
    return np.concatenate(errors), np.concatenate(terms)


def validation_errors(
    images: list[NDArray[np.float64]], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return error/scale of some pixels and colors, and log(1 + expected ones)."""
    ratios, ones = [], []
    for pixels, truth in scenes(images, rng):
        colors = pixels.estimate()
        scales, _ = pixels.scale(error_model(COLOR_FILE), colors, pixels.halves())
        for color, scale in enumerate(scales):
            gray = pixels.colors_of(color)
            z, exact = (gray.stabilize(each[..., color]) for each in (colors, truth))
            chosen = rng.choice(z.size, PIXELS, replace=False)
            ratios.append(((exact - z) / scale).flat[chosen])
            ones.append(np.log1p(np.maximum(gray.trials, 0.5) * np.sin(z) ** 2).flat[chosen])
    return np.concatenate(ratios), np.concatenate(ones)


if __name__ == "__main__":
    main()
