"""Measure the errors of the network "medium" on photographs, for `jotlight.uncertainty`.

    python tools/calibrate_intervals.py path/to/data

Training photographs (see `training_data`) determine the scale of the errors, and validation
photographs the quantiles of error/scale. A third of the photographs is made linear in light. The
result goes to ``python/jotlight/evaluation/error_scale.json``. It takes ten minutes on one core.
"""

import argparse
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import training_data
from numpy.typing import NDArray

import jotlight as jl
from jotlight.evaluation.error_scale import FILE, ErrorModel, divide_bits, error_model, error_terms
from jotlight.evaluation.interval_pixels import Pixels, stabilize
from jotlight.evaluation.intervals import TYPICAL_DEVIATION, estimate_halves
from jotlight.sensing.pixel_counts import count_pixels

TRIALS = 1, 2, 3, 4, 6, 9, 16, 25, 36, 64, 100, 256, 1024, 4096
PHOTONS = 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0
"""Photons per jot and frame at intensity 1."""

FOLDERS = "photographs/cid22", "photographs/clic2025", "bsds500_extra"
PHOTOGRAPHS, SIDE = 40, 224
"""Maximum number of training photographs of each folder, and their largest side."""

IMAGES, PIXELS = 8, 1500
"""Number of photographs for each K and exposure, and of pixels of each."""

TAILS = 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.16, 0.25
CLASSES = 8
"""Number of classes of expected ones."""

LINEAR_FRACTION, GAMMA = 1 / 3, 2.2
STEPS, PENALTY = 400, 1e-5
"""Maximum number of steps of the fit, and its quadratic penalty."""

_DEVIATION_TAIL = 1e-3
"""Fraction of the errors on each side that are clipped for their root mean square."""

Errors = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Errors of z, their scale or its terms, and log(1 + expected ones)."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore", jl.JotlightWarning)
    rng = np.random.default_rng(0)
    weights = fit_weights(*training_errors(training_images(options.data, rng), rng))
    table = np.ones((2, len(TAILS)))
    deviation = np.full(2, TYPICAL_DEVIATION)
    model = ErrorModel(weights, np.arange(2.0), np.array(TAILS), -table, table, deviation)
    images = training_data.validation_images(options.data)
    # The correction by held-out bits depends on the deviation, so the second pass uses that of the
    # first.
    for _ in range(2):
        model.write(FILE)
        error_model.cache_clear()
        model = tabulate(weights, *validation_errors(images, rng))
    model.write(FILE)


def training_images(data: Path, rng: np.random.Generator) -> list[NDArray[np.float32]]:
    """Return the central parts of some training photographs, in gray."""
    images = []
    for folder in FOLDERS:
        files = training_data.training_files(data, folder)
        for index in rng.choice(len(files), min(len(files), PHOTOGRAPHS), replace=False):
            image = jl.read_image(files[index], gray=True).astype(np.float32)
            (top, left) = (max(0, (size - SIDE) // 2) for size in image.shape)
            images.append(np.ascontiguousarray(image[top : top + SIDE, left : left + SIDE]))
    return images


def exposures(
    images: Sequence[NDArray[np.floating]], rng: np.random.Generator
) -> Iterator[tuple[Pixels, NDArray[np.float64]]]:
    """Yield counts of photographs at all K and exposures, and the true z."""
    for trials in TRIALS:
        for photons in PHOTONS:
            sensor = jl.Sensor(frames=trials, gain=photons * trials)
            for index in rng.choice(len(images), IMAGES, replace=False):
                image = images[index].astype(np.float64)
                if rng.random() < LINEAR_FRACTION:
                    image **= GAMMA
                counts = sensor.expose(image, rng=int(rng.integers(1 << 30))).counts()
                yield (
                    Pixels.of(count_pixels(counts[None], sensor, 1), 0),
                    stabilize(image, sensor, 1, 0),
                )


def training_errors(images: list[NDArray[np.float32]], rng: np.random.Generator) -> Errors:
    """Return errors of some pixels, and the terms of their scale."""
    errors, terms = [], []
    for pixels, truth in exposures(images, rng):
        z = pixels.stabilize(estimate(pixels))
        chosen = rng.choice(z.size, min(z.size, PIXELS), replace=False)
        errors.append((truth - z).flat[chosen])
        of_image = [term.flat[chosen] for term in error_terms(z, pixels.trials)]
        terms.append(np.stack(of_image, axis=1))
    return np.concatenate(errors), np.concatenate(terms)


def estimate(pixels: Pixels) -> NDArray[np.float32]:
    return network(pixels.sensor).reconstruct(pixels.ones, pixels.sensor, threads=1)


def network(sensor: jl.Sensor) -> jl.Network:
    return jl.pretrained(sensor, "medium")


def fit_weights(errors: NDArray[np.float64], terms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights of the terms under which the errors are most likely.

    The errors have a Laplace distribution, log density -log s - |e|/s, which is robust.
    """
    from scipy.optimize import minimize

    mean, deviation = terms.mean(0), terms.std(0)
    mean[0], deviation[0] = 0, 1
    normal, size = (terms - mean) / deviation, np.abs(errors) + 1e-5

    def cost(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        logarithm = normal @ weights
        ratio = size * np.exp(-logarithm)
        slope = np.r_[0.0, weights[1:]]
        value = (logarithm + ratio).mean() + PENALTY * slope @ slope
        return value, normal.T @ (1 - ratio) / len(ratio) + 2 * PENALTY * slope

    start = np.r_[np.log(size.mean()), np.zeros(normal.shape[1] - 1)]
    found = minimize(cost, start, jac=True, method="L-BFGS-B", options={"maxiter": STEPS})
    print(f"scale: {found.message}, cost {found.fun:.4f}", flush=True)
    weights = found.x / deviation
    weights[0] -= (weights * mean).sum()
    return weights


def validation_errors(
    images: list[NDArray[np.float64]], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return error/scale of some pixels, and log(1 + expected ones)."""
    ratios, ones = [], []
    for pixels, truth in exposures(images, rng):
        values = estimate(pixels)
        halves = divide_bits(pixels.ones, pixels.trials)
        [of_halves] = estimate_halves(network(pixels.sensor), [pixels], [halves], 1)
        errors = pixels.errors(halves, of_halves)
        z, scale = pixels.stabilize(values), pixels.scale(values, errors, error_model())
        chosen = rng.choice(z.size, PIXELS, replace=False)
        ratios.append(((truth - z) / scale).flat[chosen])
        ones.append(np.log1p(pixels.trials * np.sin(z) ** 2).flat[chosen])
    return np.concatenate(ratios), np.concatenate(ones)


def tabulate(
    weights: NDArray[np.float64], ratios: NDArray[np.float64], ones: NDArray[np.float64]
) -> ErrorModel:
    """Return the model with the quantiles of error/scale in each class of expected ones."""
    classes = np.array_split(np.argsort(ones), CLASSES)
    tails = np.array(TAILS)
    clipped = [
        np.clip(ratios[each], *np.quantile(ratios[each], [_DEVIATION_TAIL, 1 - _DEVIATION_TAIL]))
        for each in classes
    ]
    return ErrorModel(
        weights=weights,
        ones=np.array([np.median(ones[each]) for each in classes]),
        tails=tails,
        low=np.array([np.quantile(ratios[each], tails) for each in classes]),
        high=np.array([np.quantile(ratios[each], 1 - tails) for each in classes]),
        deviation=np.array([np.sqrt(np.mean(each**2)) for each in clipped]),
    )


if __name__ == "__main__":
    main()
