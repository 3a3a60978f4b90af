"""Data with different gains and thresholds for methods that expect one of each."""

from collections.abc import Callable
from typing import Any

from jotlight.estimators.merge_readings import merge_images, reference_sensor
from jotlight.evaluation.methods import LARGE_METHOD, find_method
from jotlight.networks.network import Network
from jotlight.sensing.pixel_counts import GrayImages
from jotlight.sensing.readings import require_plain_bits
from jotlight.sensing.sensor import Sensor


def with_one_response(
    images: GrayImages,
    sensor: Sensor,
    method: str | Network | Callable[..., Any] | None,
    quality: str | None,
    threads: int | None,
) -> tuple[GrayImages, Sensor]:
    """Return equivalent counts for a method, and their sensor with one gain and one threshold.

    Parameters
    ----------
    images : GrayImages
        The data of a sensor whose readings differ.
    sensor : Sensor
        That sensor.
    method : str, Network, or callable, optional
        The method: a K-conditioned network, the name of a shipped one, or "held-out". Default: the
        recommended one.
    quality : str, optional
        The size of a shipped network.
    threads : int, optional
        The number of threads. Default: all cores.

    Raises
    ------
    ValueError
        When the method does not serve such sensors.

    Examples
    --------
    >>> from jotlight.sensing.pixel_counts import gray_images
    >>> import numpy as np
    >>> sensor = Sensor(frames=2, gain=[1.0, 8.0])
    >>> bits = sensor.expose(np.full((2, 2), 0.5), rng=0)
    >>> with_one_response(gray_images(bits), sensor, None, None, None)[1]
    Sensor(frames=2)
    """
    if isinstance(method, Network):
        is_served = method.trials_range is not None
    elif isinstance(method, str):
        is_served = method == LARGE_METHOD or find_method(method).quality is not None
    else:
        is_served = method is None
    if not is_served:
        require_plain_bits(sensor)
    return merge_images(images, sensor, threads), reference_sensor(sensor)
