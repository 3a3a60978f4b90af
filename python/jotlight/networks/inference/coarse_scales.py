"""Few photons: a K-conditioned network sees the coarse structure of a scene in squares of pixels.

A network sees the neighborhood of a pixel. If all of it holds only a few ones, its mean light is
uncertain, and the estimate is too bright or has spots. Squares of 2 x 2 pixels have four times as
many ones, and a network sees twice as far in them. So the probability p of a one gains what the
squares say about its coarse structure::

    p + enlarge(w (p' - mean of p over the square)),    w = 1 / (1 + 2 I),

where p' is the probability of a square, and I is the Fisher information of a pixel about the
logarithm of its intensity. In dim scenes, I is the expected number of detected photons. The result
is at least the smaller one of p and p'. Squares may gain from squares of squares in the same way.
"""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.likelihood.reference import reading_information, reference_jot, response_of
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.maps import dark_counts_of_mean
from jotlight.sensing.parameters.response import intensity_at_probability
from jotlight.sensing.sensor import Sensor
from jotlight.squares import sum_squares

_FEW = 3.0
"""Detected photons of a pixel above which squares say too little to be worth their time."""

_MIN_SIDE = 32
"""Smallest height and width of an image, in pixels, that has squares."""


def log_information(intensity: npt.ArrayLike, sensor: Sensor, trials: npt.ArrayLike) -> Array:
    """Return the Fisher information of pixels about the logarithms of their intensities.

    Parameters
    ----------
    intensity : array_like
        The intensities.
    sensor : Sensor
        The sensor.
    trials : array_like
        The number of trials of each pixel.

    Examples
    --------
    >>> dim = jl.Sensor(frames=100, gain=1.0)
    >>> log_information([0.5, 1.0], dim, 100).round(3)  # about the numbers of photons
    array([0.499, 0.995])
    """
    light = sensor.light_per_intensity * np.maximum(np.asarray(intensity, np.float64), 1e-12)
    number = np.asarray(trials, np.float64)
    return np.asarray(light**2 * number * reading_information(sensor, light))


def has_few_photons(image: Image, sensor: Sensor, trials: float) -> bool:
    """Return whether an image gains from squares of pixels.

    Parameters
    ----------
    image : ndarray of float32, shape (H, W)
        The estimate without squares.
    sensor : Sensor
        The sensor.
    trials : float
        The usual number of trials of a pixel.

    Examples
    --------
    >>> image = np.full((64, 64), 0.5, np.float32)
    >>> has_few_photons(image, jl.Sensor(), 1), has_few_photons(image, jl.Sensor(frames=16), 16)
    (True, False)
    """
    efficiency, _ = reference_jot(sensor)
    mean = float(image.mean(dtype=np.float64))
    light = efficiency * sensor.light_per_intensity * mean
    photons = light * trials
    # With fewer photons than its threshold, a jot hardly reports them.
    if light < sensor.threshold > 1:
        photons = min(photons, float(log_information(mean, sensor, trials)))
    return min(image.shape) >= _MIN_SIDE and photons < _FEW


def sensor_of_squares(sensor: Sensor) -> Sensor:
    """Return the sensor of squares of 2 x 2 pixels, with the same light per jot and frame.

    Examples
    --------
    >>> sensor_of_squares(jl.Sensor(frames=4)).trials
    16
    """
    return sensor.replace(
        frames=4 * sensor.trials, gain=4 * sensor.gain, oversampling=1, kernel="box", mask=None
    )


def counts_of_squares(pixels: PixelCounts) -> list[Merged]:
    """Return the counts of squares of 2 x 2 pixels of each image.

    Parameters
    ----------
    pixels : PixelCounts
        The counts of the pixels, (N, H, W).
    """
    trials = np.broadcast_to(np.asarray(pixels.trials, np.float64), pixels.counts.shape)
    maps = jots_of_squares(pixels.sensor, trials, pixels.efficiency, pixels.dark_counts)
    sums = sum_squares(pixels.counts), sum_squares(trials)
    sensor = sensor_of_squares(pixels.sensor)
    means = (each if isinstance(each, np.ndarray) else [each] * len(trials) for each in maps)
    return [
        Merged(ones, number, sensor, dark_counts=dark, efficiency=efficiency)
        for ones, number, efficiency, dark in zip(*sums, *means, strict=True)
    ]


def jots_of_squares(
    sensor: Sensor, trials: Array, efficiency: float | Array, dark_counts: float | Array
) -> tuple[float | Array, float | Array]:
    """Return the efficiency and the dark counts of squares of 2 x 2 pixels.

    They are those of :class:`jotlight.Merged`: means over the trials of the pixels, and for
    threshold 1, the dark counts that cause as many ones. Numbers stay numbers.

    Parameters
    ----------
    sensor : Sensor
        The sensor, which states the threshold.
    trials : ndarray, shape (..., H, W)
        The number of trials of each pixel.
    efficiency, dark_counts : float or ndarray, shape (..., H, W)
        Those of the pixels.

    Examples
    --------
    >>> efficiency, dark_counts = np.array([[0.5, 0.75], [0.5, 0.75]]), 0.1
    >>> jots_of_squares(jl.Sensor(), np.ones((2, 2)), efficiency, dark_counts)
    (array([[0.625]]), 0.1)
    """
    weights = np.maximum(trials, 1e-9)  # a square without trials has the mean of its pixels

    def mean(values: Array) -> Array:
        return np.asarray(sum_squares(weights * values) / sum_squares(weights))

    if isinstance(efficiency, np.ndarray):
        efficiency = mean(efficiency)
    if isinstance(dark_counts, np.ndarray):
        is_first = sensor.threshold == 1
        dark_counts = dark_counts_of_mean(dark_counts, mean) if is_first else mean(dark_counts)
    return efficiency, dark_counts


def add_coarse(fine: Image, coarse: Image, sensor: Sensor, trials: npt.ArrayLike) -> Image:
    """Return an image that gains what squares of pixels say about its coarse structure.

    Parameters
    ----------
    fine : ndarray of float32, shape (H, W)
        The intensities c of the pixels.
    coarse : ndarray of float32
        The intensities c' of the squares.
    sensor : Sensor
        The sensor of the squares.
    trials : array_like
        The number of trials of each square.
    """
    from scipy.ndimage import zoom

    response = response_of(sensor)
    p = response(np.asarray(fine, np.float64))
    of_pixels = log_information(coarse, sensor, np.asarray(trials, np.float64) / 4)
    of_squares = response(np.asarray(coarse, np.float64))
    change = (of_squares - sum_squares(p) / 4) / (1 + 2 * of_pixels)
    enlarged = zoom(change, 2, order=3, mode="reflect", grid_mode=True)
    found = (p + enlarged[: p.shape[0], : p.shape[1]]).clip(0, 1)
    # Next to bright pixels, the change may exceed p. Both estimates say that there is more light.
    blocks = zoom(of_squares, 2, order=0, mode="reflect", grid_mode=True)
    found = np.maximum(found, np.minimum(p, blocks[: p.shape[0], : p.shape[1]]))
    efficiency, dark_counts = reference_jot(sensor)
    slope = efficiency * sensor.light_per_intensity
    intensity = intensity_at_probability(sensor.threshold, found, 1 - found, slope, dark_counts)
    return intensity.clip(0, sensor.max_intensity).astype(np.float32)
