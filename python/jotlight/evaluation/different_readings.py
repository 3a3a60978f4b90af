"""Readings that a count of ones does not describe, for methods that take counts."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from jotlight.blur import blur
from jotlight.errors import hide_warnings
from jotlight.estimators.merge_readings import merge_joint
from jotlight.estimators.readings.merge_near import Merging
from jotlight.estimators.readings.reference_sensors import reference_sensor
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.intervals.interval_pixels import find_unbounded
from jotlight.evaluation.methods import COLOR_NETWORK, find_method
from jotlight.layout import join
from jotlight.networks.loading import AnyNetwork
from jotlight.networks.network import Network
from jotlight.networks.pretrained import DEFAULT_SIZE, pretrained_conditional
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.likelihood.joint_likelihood import JointLikelihood, joint_likelihood
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import require_plain_bits
from jotlight.sensing.sensor import Sensor

_ITERATIVE = "mle-iterative"
"""Name of iterative maximum likelihood."""

_ROUNDS = 2
"""Number of estimates near which readings are merged, one after the other."""

_NEIGHBORHOOD = 1.0
"""Standard deviation of the filter of these estimates, in pixels.

Their own noise would bias the counts.
"""


def with_one_response(
    images: GrayImages,
    sensor: Sensor,
    method: str | AnyNetwork | Callable[..., Any] | None,
    threads: int | None,
    *,
    keeps_maximum: bool = False,
) -> tuple[GrayImages, Sensor]:
    """Return equivalent counts for a method, and their sensor, which has plain bits.

    Denoisers expect numbers of trials that do not depend on the noise. Those at the most likely
    intensity of each pixel depend on it. So networks get counts near estimates of a network, and
    other methods counts near averages over neighbors. Iterative maximum likelihood gets those at
    the maximum, as it searches for it.

    Parameters
    ----------
    images : GrayImages
        The data of a sensor whose readings differ.
    sensor : Sensor
        That sensor.
    method : str, Network, or callable, optional
        The method. Default: the recommended one.
    threads : int, optional
        The number of threads. Default: the number of cores.
    keeps_maximum : bool
        Whether counts for iterative maximum likelihood always have the most likely intensities of
        the readings. Their information may differ.

    Raises
    ------
    ValueError
        When the method is a network for one number of trials, because equivalent counts have
        different ones.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import gray_images
    >>> import numpy as np
    >>> sensor = jl.Sensor(frames=2, gain=[1.0, 8.0])
    >>> bits = sensor.expose(np.full((2, 2), 0.5), rng=0)
    >>> with_one_response(gray_images(bits), sensor, None, None)[1]
    Sensor(frames=2)
    """
    if isinstance(method, Network) and method.trials_range is None:
        require_plain_bits(sensor)
    merge = _merging_for(method, threads, keeps_maximum=keeps_maximum)
    each = [merge(joint_likelihood(one, sensor, threads)) for one in images.data]
    return GrayImages(each, images.layout), reference_sensor(sensor)


def with_saturation(
    found: Uncertainty, images: GrayImages, sensor: Sensor, threads: int | None
) -> Uncertainty:
    """Return the uncertainty of images where their readings are saturated.

    Equivalent counts are never saturated. Where all readings around a pixel are the largest one,
    intervals end at S.

    Parameters
    ----------
    found : Uncertainty
        The uncertainty by equivalent counts.
    images : GrayImages
        The data of a sensor whose readings differ.
    sensor : Sensor
        That sensor.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    saturated, unbounded = [], []
    for each in images.data:
        joint = joint_likelihood(each, sensor, threads)
        saturated.append(((joint.total == joint.max_total) & (joint.trials > 0))[None])
        unbounded.append(find_unbounded(joint.total, joint.max_total, joint.trials)[None])
    is_saturated, is_unbounded = (
        images.layout.arrange(join(parts)) for parts in (saturated, unbounded)
    )
    high = np.where(is_unbounded, np.float32(sensor.max_intensity), found.high)
    return dataclasses.replace(found, saturated=is_saturated, high=high)


def _merging_for(
    method: str | AnyNetwork | Callable[..., Any] | None,
    threads: int | None,
    *,
    keeps_maximum: bool,
) -> Callable[[JointLikelihood], Merged]:
    """Return the function from a likelihood to the equivalent counts for a method."""
    if method == _ITERATIVE:
        return partial(merge_joint, keeps_maximum=keeps_maximum)
    if _is_network(method):
        return partial(_merge_for_network, threads=threads)
    return lambda joint: Merging(joint).near_neighbors()


def _merge_for_network(joint: JointLikelihood, threads: int | None) -> Merged:
    """Return equivalent counts of a gray image near estimates of a network."""
    merging = Merging(joint)
    merged = merging.near_neighbors()
    if joint.sensor.has_plain_bits:
        return merged
    network = pretrained_conditional(merged.sensor, DEFAULT_SIZE)
    for _ in range(_ROUNDS):
        with hide_warnings():  # the estimate from the result warns, too
            estimate = network.reconstruct(merged, threads=threads)
        merged = merging.near(blur(estimate, _NEIGHBORHOOD, threads))
    return merged


def _is_network(method: object) -> bool:
    """Return whether a method is a network or the name of one, or the recommended method."""
    if isinstance(method, str) and method != COLOR_NETWORK:
        return find_method(method).quality is not None
    return method is None or isinstance(method, Network | str)


def takes_readings(method: str | None, sensor: Sensor) -> bool:
    """Return whether a method takes the readings of a sensor as they are.

    Examples
    --------
    >>> several = jl.Sensor(frames=2, bit_depth=4)
    >>> takes_readings("noniterative-tv", several), takes_readings("admm-tv", several)
    (True, False)
    """
    if sensor.has_plain_bits or method == "mle":
        return True
    is_noniterative = method is not None and method.startswith("noniterative-")
    return is_noniterative and not sensor.readings_differ
