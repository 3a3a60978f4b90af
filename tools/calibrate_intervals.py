"""Measure the errors of the network "medium" on photographs, for `jotlight.uncertainty`.

    python tools/calibrate_intervals.py path/to/data

Training photographs (see `training_data`) determine the scale of the errors, and training and
validation photographs the quantiles of error/scale. A third of the photographs is made linear in
light. The result goes to ``python/jotlight/evaluation/intervals/error_scale.json``. It takes ten
minutes on one core.
"""

import argparse
import itertools
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jotlight as jl
import training_data
from jotlight.evaluation.intervals.error_scale import (
    FILE,
    WINDOWS,
    ErrorModel,
    combine_dim,
    divide_bits,
    error_model,
    error_terms,
    log_activity,
    log_ones,
)
from jotlight.evaluation.intervals.interval_pixels import Pixels
from jotlight.evaluation.intervals.intervals import estimate_halves
from jotlight.evaluation.intervals.known_errors import TYPICAL_DEVIATION
from jotlight.sensing.data.pixel_counts import count_pixels
from pixel_classes import classify

TRIALS = 1, 2, 3, 4, 6, 9, 16, 25, 36, 64, 100, 256, 1024, 4096
PHOTONS = 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0
"""Photons per jot and frame at intensity 1."""

DIM_PHOTONS, MIN_PHOTONS = (0.002, 0.005), 0.02
"""Photons of dim scenes, and the smallest number of photons per pixel."""

FOLDERS = "photographs/cid22", "photographs/clic2025", "bsds500_extra"
PHOTOGRAPHS, SIDE = 40, 224
"""Maximum number of training photographs of each folder, and the largest side of all."""

IMAGES, PIXELS = 8, 1500
"""Number of photographs for each K and exposure, and of pixels of each."""

CLASS_WEIGHTS = np.array([0.7, 1.0, 1.1])
"""Weights of flat, edge, and texture pixels for the quantiles. Flat pixels have the smallest
errors, so without weights photographs with fewer of them are covered less."""

TAILS = 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.16, 0.25
CLASSES = 8, 4
"""Number of classes of expected ones, and of activity in each of them."""

LINEAR_FRACTION, GAMMA = 1 / 3, 2.2
STEPS, PENALTY = 400, 1e-5
"""Maximum number of steps of the fit, and its quadratic penalty."""

_DEVIATION_TAIL = 1e-3
"""Fraction of the errors on each side that are clipped for their root mean square."""

Errors = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Errors of z, and the terms of their scale."""

Ratios = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Error/scale, log(1 + expected ones), activity, and weight of some pixels."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore", jl.JotlightWarning)
    rng = np.random.default_rng(0)
    images = training_images(options.data, rng)
    weights = fit_weights(*training_errors(images, rng))
    model = start_model(weights)
    images += [central_part(image) for image in training_data.validation_images(options.data)]
    # The correction by held-out bits depends on the deviation, so the second pass uses that of the
    # first.
    for _ in range(2):
        model.write(FILE)
        error_model.cache_clear()
        model = tabulate(weights, *error_ratios(images, rng))
    model.write(FILE)


def start_model(weights: NDArray[np.float64]) -> ErrorModel:
    """Return a model whose quantiles are all 1, to start with."""
    table = np.ones((2, 1, len(TAILS)))
    deviation = np.full(2, TYPICAL_DEVIATION)
    nodes = np.arange(2.0), np.zeros((2, 1))
    return ErrorModel(weights, *nodes, np.array(TAILS), -table, table, deviation)


def central_part(image: NDArray[np.float32]) -> NDArray[np.float32]:
    top, left = (max(0, (size - SIDE) // 2) for size in image.shape)
    return np.ascontiguousarray(image[top : top + SIDE, left : left + SIDE])


def training_images(data: Path, rng: np.random.Generator) -> list[NDArray[np.float32]]:
    """Return the central parts of some training photographs, in gray."""
    images = []
    for folder in FOLDERS:
        files = training_data.training_files(data, folder)
        for index in rng.choice(len(files), min(len(files), PHOTOGRAPHS), replace=False):
            image = jl.read_image(files[index], gray=True).astype(np.float32)
            images.append(central_part(image))
    return images


def exposures(
    images: Sequence[NDArray[np.floating]], rng: np.random.Generator
) -> Iterator[tuple[Pixels, NDArray[np.float64]]]:
    """Yield counts of photographs at all K and exposures, and the true intensity."""
    for trials, photons in itertools.product(TRIALS, DIM_PHOTONS + PHOTONS):
        if trials * photons < MIN_PHOTONS:
            continue
        sensor = jl.Sensor(frames=trials, gain=photons * trials)
        for index in rng.choice(len(images), IMAGES, replace=False):
            image = images[index].astype(np.float64)
            if rng.random() < LINEAR_FRACTION:
                image **= GAMMA
            counts = sensor.expose(image, rng=int(rng.integers(1 << 30))).counts()
            yield Pixels.of(count_pixels(counts[None], sensor, 1), 0), image


def training_errors(images: list[NDArray[np.float32]], rng: np.random.Generator) -> Errors:
    """Return errors of some pixels, and the terms of their scale."""
    errors, terms = [], []
    for pixels, image in exposures(images, rng):
        z, exact = pixels.stabilize(estimate(pixels)), pixels.stabilize(image)
        chosen = rng.choice(z.size, min(z.size, PIXELS), replace=False)
        dim, trials, factor = combine_dim(z, pixels.trials)
        errors.append(np.sqrt(factor) * (exact - z).flat[chosen])
        of_image = [term.flat[chosen] for term in error_terms(dim, trials)]
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


def error_ratios(images: list[NDArray[np.float32]], rng: np.random.Generator) -> Ratios:
    """Return error/scale of some pixels, their ones, their activity, and their weights."""
    found = []
    for pixels, image in exposures(images, rng):
        values = estimate(pixels)
        halves = divide_bits(pixels.ones, pixels.trials)
        [of_halves] = estimate_halves(network(pixels.sensor), [pixels], [halves], 1)
        errors = pixels.errors(halves, of_halves)
        z = pixels.stabilize(values)
        scale = pixels.known_errors(values, errors, error_model()).scale
        of_pixels = (
            (pixels.stabilize(image) - z) / scale,
            log_ones(z, pixels.trials),
            log_activity(z, pixels.trials, WINDOWS[1]),
            CLASS_WEIGHTS[classify(image)],
        )
        chosen = rng.choice(z.size, min(z.size, PIXELS), replace=False)
        found.append([each.flat[chosen] for each in of_pixels])
    ratios, ones, activity, weights = (np.concatenate(each) for each in zip(*found, strict=True))
    return ratios, ones, activity, weights


def tabulate(
    weights: NDArray[np.float64],
    ratios: NDArray[np.float64],
    ones: NDArray[np.float64],
    activity: NDArray[np.float64],
    importance: NDArray[np.float64],
    classes: tuple[int, int] = CLASSES,
) -> ErrorModel:
    """Return the model with the quantiles of error/scale in each class of ones and activity.

    `importance` weighs the pixels for the quantiles.
    """
    of_ones = np.array_split(np.argsort(ones), classes[0])
    cells = [np.array_split(each[np.argsort(activity[each])], classes[1]) for each in of_ones]
    tails = np.array(TAILS)

    def quantiles(levels: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array(
            [[weighted_quantiles(ratios[c], importance[c], levels) for c in row] for row in cells]
        )

    clipped = [
        np.clip(ratios[each], *np.quantile(ratios[each], [_DEVIATION_TAIL, 1 - _DEVIATION_TAIL]))
        for each in of_ones
    ]
    return ErrorModel(
        weights=weights,
        ones=np.array([np.median(ones[each]) for each in of_ones]),
        activity=np.array([[np.median(activity[cell]) for cell in row] for row in cells]),
        tails=tails,
        low=quantiles(tails),
        high=quantiles(1 - tails),
        deviation=np.array([np.sqrt(np.mean(each**2)) for each in clipped]),
    )


def weighted_quantiles(
    values: NDArray[np.float64], weights: NDArray[np.float64], levels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the quantiles of values that count with weights."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return np.asarray(np.interp(levels * total[-1], total - weights[order] / 2, values[order]))


if __name__ == "__main__":
    main()
