"""Images of few photons: a twin of their correction by squares of pixels, in NumPy and SciPy."""

import numpy as np
from scipy.ndimage import zoom

from jotlight.networks.inference.coarse_scales import sensor_of_squares
from jotlight.sensing.likelihood.reference import reading_information, reference_jot, response_of
from jotlight.sensing.parameters.response import intensity_at_probability
from jotlight.squares import sum_squares
from reference import dim_scenes


def corrected(network, counts, sensor):
    """Return the intensities of counts (H, W) of equal jots, with all corrections."""
    image = dim_scenes.corrected(network, counts, sensor)
    if not has_few_photons(image, sensor, sensor.trials):
        return image
    squares = sensor_of_squares(sensor)
    coarse = corrected(network, sum_squares(counts).astype(np.int32), squares)
    return add_coarse(image, coarse, squares, squares.trials)


def log_information(intensity, sensor, trials):
    """Return the Fisher information about the logarithms of intensities."""
    light = sensor.light_per_intensity * np.maximum(np.asarray(intensity, np.float64), 1e-12)
    return light**2 * np.asarray(trials, np.float64) * reading_information(sensor, light)


def has_few_photons(image, sensor, trials):
    """Return whether an image gains from squares of pixels."""
    efficiency, _ = reference_jot(sensor)
    mean = float(image.mean(dtype=np.float64))
    light = efficiency * sensor.light_per_intensity * mean
    photons = light * trials
    if light < sensor.threshold > 1:
        photons = min(photons, float(log_information(mean, sensor, trials)))
    return min(image.shape) >= 32 and photons < 3


def add_coarse(fine, coarse, sensor, trials):
    """Return an image with the coarse structure of its squares."""
    response = response_of(sensor)
    p = response(np.asarray(fine, np.float64))
    of_pixels = log_information(coarse, sensor, np.asarray(trials, np.float64) / 4)
    of_squares = response(np.asarray(coarse, np.float64))
    change = (of_squares - sum_squares(p) / 4) / (1 + 2 * of_pixels)
    enlarged, blocks = (
        zoom(image, 2, order=order, mode="reflect", grid_mode=True)[: p.shape[0], : p.shape[1]]
        for image, order in ((change, 3), (of_squares, 0))
    )
    found = np.maximum((p + enlarged).clip(0, 1), np.minimum(p, blocks))
    efficiency, dark_counts = reference_jot(sensor)
    slope = efficiency * sensor.light_per_intensity
    intensity = intensity_at_probability(sensor.threshold, found, 1 - found, slope, dark_counts)
    return intensity.clip(0, sensor.max_intensity).astype(np.float32)
