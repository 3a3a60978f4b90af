"""The array `out` of methods that estimate gray images."""

import numpy as np

from jotlight.sensing.bits.output_images import OutputImages
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.sensor import Sensor


def output_of(images: GrayImages, sensor: Sensor, out: object) -> OutputImages:
    """Return the images that a method writes for its data: those of `out`, or new ones.

    Raises
    ------
    TypeError, ValueError
        When `out` is not an array of float32 with the shape of the result.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import gray_images
    >>> images = gray_images(np.zeros((4, 6), np.int32))
    >>> output_of(images, jl.Sensor(frames=16), None).images.shape
    (1, 4, 6)
    """
    inputs = [images.data] if isinstance(images.data, np.ndarray) else []
    return OutputImages(images.layout, images.size(sensor), out, inputs=inputs)
