"""Images of dim scenes and of dark regions: twins of the corrections in the engine, in NumPy."""

import math

import numpy as np

from jotlight.blur import blur
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.sensing.likelihood.reference import reference_jot, response_of


def plain_estimate(network, counts, sensor, threads=None):
    """Return the intensities of counts (H, W) of equal jots, without any correction."""
    zeros = network.estimates_zeros(sensor)
    fraction = np.float32(counts) / np.float32(sensor.trials)
    known = [1 - fraction] if zeros else [fraction]
    (p,) = network.engine_network.denoise(known, [sensor.trials], zeros, threads)
    if not zeros:
        return intensity_from_probability(p, sensor, threads)
    efficiency, dark_counts = reference_jot(sensor)
    with np.errstate(divide="ignore"):
        rate = -np.log(p.astype(np.float64))
    light = (rate - dark_counts) / (efficiency * sensor.light_per_intensity)
    return np.float32(np.clip(light, 0, sensor.max_intensity))


def corrected(network, counts, sensor):
    """Return the intensities of counts (H, W) of equal jots, with the correction of dark ones."""
    image = plain_estimate(network, counts, sensor)
    fraction, trials = np.float32(counts) / np.float32(sensor.trials), sensor.trials
    is_dark = sensor.threshold > 1 and response_of(sensor)(image.min(keepdims=True)).min() < 5e-3
    if not (is_dim(image, sensor, trials) or is_dark):
        return image
    found = combined(fraction, trials, network.trials_range[0])
    if found is not None:
        scaled, number, factor = found
        (p,) = network.engine_network.denoise([scaled], [number], False, None)
        p_all, weight = matched(p, scaled, number, sensor.threshold) / factor, weights(p, scaled)
    elif is_dark:
        p = response_of(sensor)(image).astype(np.float32)
        p_all = matched(p, fraction, trials, sensor.threshold)
        weight = np.float32(p_all < 0.5)
    else:
        return image
    return (1 - weight) * image + weight * intensity_from_probability(p_all, sensor, None)


def is_dim(image, sensor, trials):
    """Return whether an estimate is so dark that trials may be combined."""
    if trials < 6:
        return False
    p = response_of(sensor)(np.array([image.mean(), np.quantile(image, 0.999)], np.float64))
    return bool((p + np.sqrt(p * (1 - p) / trials) < 1 / 6).all())


def factor_of(fraction, trials, smallest=1):
    """Return c, the number of trials per combined trial, or 1."""
    bright, typical = float(np.quantile(fraction, 0.999)), float(np.median(trials))
    factor = min(typical / max(4, smallest), 1 / max(4 * bright, 1 / typical))
    return factor if factor >= 1.5 else 1.0


def combined(fraction, trials, smallest=1):
    """Return the fractions and the number of combined trials, and c, or None."""
    factor = factor_of(fraction, trials, smallest)
    if factor == 1:
        return None
    if isinstance(trials, int):
        number = max(round(trials / factor), 4, smallest)
        factor = trials / number
    else:
        number = np.maximum(trials / np.float32(factor), 1)
    return np.minimum(fraction * np.float32(factor), 1), number, np.float32(factor)


def weights(p, fraction):
    """Return the weights of combined trials."""
    return np.clip((0.5 - np.maximum(p, fraction / 2)) / 0.25, 0, 1, dtype=np.float32)


def matched(probability, fraction, trials, threshold):
    """Return probabilities whose means in dark regions are those of the bits."""
    p = np.maximum(probability, 0)
    if p.min() >= 5e-3:
        return probability
    empty = _below(p, 5e-4)
    number, sums = blur(np.stack([empty * trials, empty * trials * p]), 8.0)
    p = p + empty * (sums / np.maximum(number, 1e-12) - p)
    dark = _below(p, 5e-3)
    ones, expected = blur(np.stack([dark * trials * fraction, dark * trials * p]), 8.0)
    pixels = 4 * math.pi * 64
    change = _log_of_expected(pixels * ones, threshold)
    change -= _log_of_expected(pixels * expected, threshold)
    ratio = np.exp(np.minimum(dark * change, 80))
    return np.float32(np.clip(p * ratio, np.minimum(p, np.finfo(np.float32).tiny), 1))


def _log_of_expected(ones, threshold):
    from scipy.special import gammaln

    n = ones.astype(np.float64)
    return threshold * (gammaln(n + 1.5 / threshold) - gammaln(n + 0.5 / threshold))


def _below(p, limit):
    return np.float32(1 / (1 + (p / limit) ** 2))
