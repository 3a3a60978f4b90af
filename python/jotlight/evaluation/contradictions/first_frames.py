"""Data in a form that suffices to compare them with their sensor, such as their first frames."""

import dataclasses
from typing import Any

from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.merged import is_finer
from jotlight.sensing.sensor import Sensor

_MAX_BYTES = 1 << 22
"""Maximum number of bytes of bits that are counted, of each image."""


def first_frames(images: GrayImages, sensor: Sensor) -> tuple[GrayImages, Sensor]:
    """Return the first frames of bits that are all alike, and their sensor.

    Counts, and readings that differ, stay as they are.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import gray_images
    >>> sensor = jl.Sensor(frames=8)
    >>> images = gray_images(jl.Bits.from_array([[[0, 1]]] * 8))
    >>> first_frames(images, sensor)[1]  # they are few
    Sensor(frames=8)
    """
    bits = [each for each in images.data if isinstance(each, Bits)]
    if len(bits) < len(images) or sensor.readings_differ:
        return images, sensor
    first = bits[0]
    frames = max(1, _MAX_BYTES * len(first) // max(1, first.packed.nbytes))
    if frames >= len(first):
        return images, sensor
    part = [each[:frames] for each in bits]
    return GrayImages(part, images.layout), sensor.replace(frames=frames)


def on_usual_grid(images: GrayImages) -> GrayImages:
    """Return images whose merged counts on a finer grid are taken for usual ones.

    The light of each of their readings is a mean over pixels, so the limits of pixels hold for it.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import gray_images
    >>> finer = jl.Merged([[3, 1]], 4.0, jl.Sensor(frames=4), upsample=2)
    >>> on_usual_grid(gray_images(finer)).data[0].upsample
    1
    """
    data: Any = images.data
    if not any(is_finer(one) for one in data):
        return images
    return GrayImages([dataclasses.replace(one, upsample=1) for one in data], images.layout)
