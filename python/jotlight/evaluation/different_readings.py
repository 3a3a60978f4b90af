"""Readings that a count of ones does not describe, for methods that take counts."""

from collections.abc import Callable
from typing import Any

from jotlight.estimators.merge_readings import merge_images, reference_sensor
from jotlight.networks.network import Network
from jotlight.sensing.pixel_counts import GrayImages
from jotlight.sensing.readings import require_plain_bits
from jotlight.sensing.sensor import Sensor


def with_one_response(
    images: GrayImages,
    sensor: Sensor,
    method: str | Network | Callable[..., Any] | None,
    threads: int | None,
) -> tuple[GrayImages, Sensor]:
    """Return equivalent counts for a method, and their sensor, which has plain bits.

    Parameters
    ----------
    images : GrayImages
        The data of a sensor whose readings differ.
    sensor : Sensor
        That sensor.
    method : str, Network, or callable, optional
        The method. Default: the recommended one.
    threads : int, optional
        The number of threads. Default: all cores.

    Raises
    ------
    ValueError
        When the method is a network for one number of trials, because equivalent counts have
        different ones.

    Examples
    --------
    >>> from jotlight.sensing.pixel_counts import gray_images
    >>> import numpy as np
    >>> sensor = Sensor(frames=2, gain=[1.0, 8.0])
    >>> bits = sensor.expose(np.full((2, 2), 0.5), rng=0)
    >>> with_one_response(gray_images(bits), sensor, None, None)[1]
    Sensor(frames=2)
    """
    if isinstance(method, Network) and method.trials_range is None:
        require_plain_bits(sensor)
    return merge_images(images, sensor, threads), reference_sensor(sensor)


def takes_readings(method: str | None, sensor: Sensor) -> bool:
    """Return whether a method takes the readings of a sensor as they are.

    Examples
    --------
    >>> several = Sensor(frames=2, bit_depth=4)
    >>> takes_readings("noniterative-tv", several), takes_readings("admm-tv", several)
    (True, False)
    """
    if sensor.has_plain_bits or method == "mle":
        return True
    is_noniterative = method is not None and method.startswith("noniterative-")
    return is_noniterative and not sensor.readings_differ
