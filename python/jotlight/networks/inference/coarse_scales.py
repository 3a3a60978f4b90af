"""Few photons: a K-conditioned network sees the coarse structure of a scene in squares of pixels.

The engine estimates squares of 2 x 2 pixels, and corrects the image by them. For pixels that differ
in their trials or their jots, the squares are counted here.
"""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array, Image
from jotlight.networks.inference.engine_backed import sensor_model
from jotlight.sensing.bits.values import flatten
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

_MAX_COUNT = (2**31 - 1) // 4
"""The largest count of which four are an int32, too."""


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
    return engine.has_few_photons(image, sensor_model(sensor), trials)


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


def counts_of_squares(
    pixels: PixelCounts, images: list[int], threads: int | None
) -> dict[int, Merged]:
    """Return the counts of squares of 2 x 2 pixels of some images, by their indices.

    Images whose squares may have more ones than an int32 holds are left out.

    Parameters
    ----------
    pixels : PixelCounts
        The counts of the pixels, (N, H, W).
    images : list of int
        The indices of the images.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    squares = {}
    for image in images:
        ones = pixels.counts[image]
        if ones.max() > _MAX_COUNT:
            continue
        trials, efficiency, dark_counts = (
            each[image] if isinstance(each, np.ndarray) else each
            for each in (pixels.trials, pixels.efficiency, pixels.dark_counts)
        )
        sensor = sensor_of_squares(pixels.sensor)
        squares[image] = sum_counts(ones, trials, efficiency, dark_counts, sensor, threads)
    return squares


def sum_counts(
    ones: npt.NDArray[np.int32],
    trials: float | Array,
    efficiency: float | Array,
    dark_counts: float | Array,
    sensor: Sensor,
    threads: int | None = None,
) -> Merged:
    """Return the counts of squares of 2 x 2 pixels. At the edge, pixels fill the squares twice.

    The efficiency and the dark counts of a square are those of :class:`jotlight.Merged`: means over
    the trials of its pixels, and for threshold 1, the dark counts that cause as many ones.

    Parameters
    ----------
    ones : ndarray of int32, shape (H, W)
        The number of ones of each pixel.
    trials, efficiency, dark_counts : float or ndarray of float64, shape (H, W)
        The number of trials of each pixel, and η and d of its jots.
    sensor : Sensor
        The sensor of the squares.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> efficiency = np.array([[0.5, 0.75], [0.5, 0.75]])
    >>> squares = sum_counts(np.ones((2, 2), np.int32), 2.0, efficiency, 0.1, jl.Sensor(frames=8))
    >>> squares.ones, squares.trials, squares.efficiency, squares.dark_counts
    (array([[4]], dtype=int32), 8.0, array([[0.625]]), 0.1)
    """
    jots = flatten(efficiency), flatten(dark_counts)
    counted = engine.sum_counts(ones, flatten(trials), jots, int(sensor.threshold), threads)
    sums, number, (efficiency, dark_counts) = counted
    return Merged(sums, number, sensor, dark_counts=dark_counts, efficiency=efficiency)


def add_coarse(
    fine: Image,
    coarse: Image,
    sensor: Sensor,
    trials: float | Array,
    threads: int | None = None,
) -> Image:
    """Return an image that gains what squares of pixels say about its coarse structure.

    Parameters
    ----------
    fine : ndarray of float32, shape (H, W)
        The intensities of the pixels.
    coarse : ndarray of float32, shape (⌈H/2⌉, ⌈W/2⌉)
        The intensities of the squares.
    sensor : Sensor
        The sensor of the squares.
    trials : float or ndarray of float64
        The number of trials of each square.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    return engine.add_coarse(fine, coarse, sensor_model(sensor), trials, threads)
