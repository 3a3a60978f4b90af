"""The mosaic of jots, which a calibration has, and the mosaic of pixels, which a sensor has."""

import dataclasses

import numpy as np

from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.parameters.mosaic import MAX_PERIOD, Mosaic
from jotlight.sensing.sensor import Sensor
from jotlight.squares import repeat_squares


def mosaic_of_jots(flat: object, mosaic: object, shape: tuple[int, ...]) -> Mosaic | None:
    """Return the mosaic whose filters lie on the jots of a flat capture, or None for a gray sensor.

    Parameters
    ----------
    flat : Bits or other
        The flat capture.
    mosaic : object
        The filter of each jot, or None for those of the sensor that the bits carry.
    shape : (int, int)
        Rows and columns of jots.

    Examples
    --------
    >>> mosaic_of_jots(None, "RGGB", (2, 3))
    Mosaic('RGGB')
    """
    height, width = shape
    if mosaic is not None:
        stated = Mosaic.of(mosaic)
        if not stated.repeats and stated.pattern.shape != shape:
            raise ValueError(
                f"mosaic: expected a filter for each of {height} x {width} jots, or a pattern that "
                f"repeats, got a map of {' x '.join(map(str, stated.pattern.shape))}"
            )
        return stated
    sensor = flat.sensor if isinstance(flat, Bits) else None
    if not isinstance(sensor, Sensor) or sensor.mosaic is None:
        return None
    pixels: Mosaic = sensor.mosaic
    side = sensor.oversampling
    jots = pixels.of_jots(height, width, side)
    rows, columns = (side * size for size in pixels.pattern.shape)
    repeats = pixels.repeats and max(rows, columns) <= MAX_PERIOD
    return dataclasses.replace(pixels, pattern=jots[:rows, :columns] if repeats else jots)


def has_filters_of_jots(sensor: Sensor, jots: Mosaic, shape: tuple[int, int]) -> bool:
    """Return whether the jots of a sensor, (H, W), lie behind the filters of a mosaic of jots.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=2, mosaic="RGGB")
    >>> has_filters_of_jots(sensor, Mosaic("RRGG/RRGG/GGBB/GGBB"), (8, 8))
    True
    >>> has_filters_of_jots(sensor, Mosaic("RGGB"), (8, 8))
    False
    """
    pixels = sensor.mosaic
    return (
        pixels is not None
        and pixels.filters == jots.filters
        and np.array_equal(pixels.transmission, jots.transmission)
        and np.array_equal(pixels.of_jots(*shape, sensor.oversampling), jots.full(*shape))
    )


def mosaic_of_pixels(jots: Mosaic, oversampling: int) -> Mosaic:
    """Return the mosaic of pixels of some jots per dimension.

    Raises
    ------
    ValueError
        When the jots of a pixel lie behind several filters.

    Examples
    --------
    >>> mosaic_of_pixels(Mosaic("RRGG/RRGG/GGBB/GGBB"), 2)
    Mosaic('RGGB')
    >>> mosaic_of_pixels(Mosaic("RGGB"), 2)
    Traceback (most recent call last):
      ...
    ValueError: oversampling: expected pixels whose jots lie behind one filter of ...
    """
    pattern = jots.pattern
    if jots.repeats:
        # Whole pixels have a longer period, unless it is one of jots, too.
        sizes = np.array(pattern.shape)
        pattern = np.tile(pattern, np.lcm(sizes, oversampling) // sizes)
    pixels = pattern[::oversampling, ::oversampling]
    covered = repeat_squares(pixels, oversampling)
    if not np.array_equal(covered, pattern):
        raise ValueError(
            f"oversampling: expected pixels whose jots lie behind one filter of the calibration's "
            f"{jots!r}, got pixels of {oversampling} x {oversampling} jots; leave out oversampling"
        )
    return dataclasses.replace(jots, pattern=pixels)
