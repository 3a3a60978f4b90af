"""Equivalent counts of readings with different gains and thresholds: those of one reference sensor.

The readings of a pixel have a likelihood as a function of its intensity. Equivalent counts of a
sensor with one gain and one threshold have the same maximum and the same information, so everything
that takes merged counts works on them.
"""

from __future__ import annotations

import dataclasses
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.readings.joint_mle import regular_maximum
from jotlight.estimators.readings.reference_sensors import MAX_TRIALS, light_share, reference_sensor
from jotlight.sensing.bits.channels import stack_channels
from jotlight.sensing.data.pixel_counts import Data, GrayImages, gray_images, prepare_data
from jotlight.sensing.likelihood.joint_likelihood import JointLikelihood, joint_likelihood
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.maps import pixel_means
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    silence_probability,
)
from jotlight.sensing.sensor import Sensor
from jotlight.underflow import underflows_to_0

_SATURATED = 700.0
"""Rate of a jot above which the information of its bits is 0 in double precision."""

_MIN_DENSITY = 1e-280
"""Derivative of the response of a trial below which its information is 0 in double precision."""


def merge_readings(
    data: Data, sensor: Sensor | None = None, *, threads: int | None = None
) -> Merged | Any:
    """Return equivalent counts: those of a sensor with one gain and one threshold.

    Readings with different gains or thresholds, such as a bracket of exposures, become counts of a
    reference sensor: real numbers of trials, and whole numbers of ones. The likelihood of a pixel
    has the same maximum as that of all its readings, and the same information there. All methods
    and all tied networks accept the result.

    Parameters
    ----------
    data : Bits, list of Bits, or array_like of int
        The bits; or counts (..., H, W), if each pixel is one jot whose readings are all alike.
    sensor : Sensor, optional
        The sensor that recorded the data. Default: the one that bits carry. A smooth kernel is
        treated as the box kernel.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    Merged
        Merged counts (H, W), or (H, W, C) for color. Their sensor is the
        :func:`jotlight.estimators.readings.reference_sensors.reference_sensor`. For a list or a
        stack, a list of merged counts.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together, or counts do not say which readings are 1.

    Notes
    -----
    With the derivative g of the log-likelihood and the information I at its maximum in [0, S], and
    with the probability p of a one at the reference sensor and its derivative p', the equivalent
    trials are ``n = I p (1 - p) / p'²``, and the ones are ``n p + g p (1 - p) / p'``. Inside
    (0, S), g is 0. With read noise, I is at least that at the intensity of half a photon, because
    rare readings have much information about exact darkness. Where all readings are 0 or all are
    the largest one, the ones are 0 or n, and n has the same derivative at the intensity at which
    half a one or half a zero is expected. Ones are rounded to whole numbers. Trials are then scaled
    such that the maximum stays the same. Where there is less than half a one, and the slope of ℓ at
    darkness shows that its likelihood is at least 1/e of the largest one, the ones become 0
    instead, and the trials stay. Read noise causes such pixels.

    The trials depend on the noise of the readings. So denoisers of these counts are biased if there
    are few readings. :func:`jotlight.reconstruct` and :func:`jotlight.uncertainty` of the readings
    themselves use better counts.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=48, gain=np.repeat([1.0, 8.0, 64.0], 16), max_intensity=5.0)
    >>> merged = jl.merge_readings(sensor.expose(np.array([[0.001, 0.1, 4.0]]), rng=0))
    >>> merged.sensor
    Sensor(frames=48, max_intensity=5.0)
    >>> bool(merged.trials[0, 0] > merged.trials[0, 1] > merged.trials[0, 2])
    True
    """
    prepared, sensor = prepare_data(data, sensor, may_differ=True)
    images = gray_images(prepared)
    merged = merge_images(images, sensor, threads)
    layout, each = images.layout, cast(list[Merged], merged.data)
    if layout.channel_axis is None:
        return each[0] if layout.is_single else each
    number = layout.shape[-1]
    colors = [join_channels(each[i : i + number]) for i in range(0, len(each), number)]
    return colors[0] if len(layout.shape) == 1 else colors


def merge_images(images: GrayImages, sensor: Sensor, threads: int | None) -> GrayImages:
    """Return the equivalent counts of gray images. Each of them states its sensor."""
    each = [merge_joint(joint_likelihood(one, sensor, threads)) for one in images.data]
    return GrayImages(each, images.layout)


def merge_joint(joint: JointLikelihood, *, keeps_maximum: bool = False) -> Merged:
    """Return the equivalent counts of a gray image.

    If `keeps_maximum` is true, they have the most likely intensities of the readings also in pixels
    that may be dark.
    """
    if joint.sensor.has_plain_bits and all(term.side == 1 for term in joint.terms):
        counts = joint.total.astype(np.int32)
        efficiency, dark_counts = mean_jots(joint.sensor)
        return Merged(
            counts, joint.trials, joint.sensor, dark_counts=dark_counts, efficiency=efficiency
        )
    reference = reference_sensor(joint.sensor)
    efficiency, dark_counts = mean_jots(reference)
    intensity = regular_maximum(joint)
    ones, trials = counts_at_maximum(joint, reference, intensity)
    share = light_share(joint.sensor, reference)
    is_kept = keeps_maximum | may_exclude_darkness(joint, intensity)
    return Merged(
        *round_ones(ones, trials, keeps_maximum=is_kept),
        reference,
        dark_counts=dark_counts,
        efficiency=efficiency,
        light_share=share,
        valid_up_to=reference.max_intensity,
    )


@underflows_to_0
def may_exclude_darkness(joint: JointLikelihood, intensity: Array) -> npt.NDArray[np.bool_]:
    """Return where darkness may be less likely than the most likely intensities by more than 1 nat.

    The log-likelihood is concave, so it is below its tangent at intensity 0. Where this rises by at
    most 1 nat up to the most likely intensity, darkness is at least 1/e times as likely.

    Examples
    --------
    >>> joint = joint_likelihood(np.array([[0, 1]], np.int32), jl.Sensor(frames=4), None)
    >>> may_exclude_darkness(joint, regular_maximum(joint))
    array([[False,  True]])
    """
    with np.errstate(over="ignore"):
        return np.asarray(joint.gradient_and_curvature(0.0)[0] * intensity > 1)


def counts_at_maximum(
    joint: JointLikelihood, reference: Sensor, intensity: Array
) -> tuple[Array, Array]:
    """Return the ones and the trials of a reference sensor that say the same at the maximum.

    They are real numbers, of the shape of the pixels.

    Parameters
    ----------
    joint : JointLikelihood
        The likelihood of the readings.
    reference : Sensor
        The :func:`jotlight.estimators.readings.reference_sensors.reference_sensor` of the readings.
    intensity : ndarray of float, shape (H, W)
        The maximum, from :func:`jotlight.estimators.readings.joint_mle.regular_maximum`.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=2, gain=[1.0, 3.0], max_intensity=9.0)
    >>> joint = joint_likelihood(jl.Bits.from_array([[[1]], [[0]]]), sensor, None)
    >>> ones, trials = counts_at_maximum(joint, reference_sensor(sensor), regular_maximum(joint))
    >>> ones.round(4), trials.round(4), (ones / trials).round(4)  # 1/4 at x = log(4/3)
    (array([[0.7973]]), array([[3.1892]]), array([[0.25]]))
    """
    efficiency, dark_counts = mean_jots(reference)
    gradient = joint.gradient_and_curvature(intensity)[0]
    least = np.maximum(intensity, min_light(joint))
    information = joint.information(least)
    slope = efficiency * reference.light_per_intensity
    is_known = joint.trials > 0
    return counts_of_equal_likelihood(
        np.where(is_known, gradient, 0.0),
        np.where(is_known, information, 0.0),
        slope,
        slope * intensity + dark_counts,
        slope * least + dark_counts,
        is_dark=joint.total == 0,
        is_full=joint.total == joint.max_total,
        threshold=int(reference.threshold),
    )


def counts_of_equal_likelihood(
    gradient: Array,
    information: Array,
    slope: float | Array,
    rate: Array,
    rate_of_information: Array,
    *,
    is_dark: npt.NDArray[np.bool_],
    is_full: npt.NDArray[np.bool_],
    threshold: int = 1,
) -> tuple[Array, Array]:
    """Return the numbers of ones and of trials whose likelihood is that of other readings.

    The formulas are in the notes of :func:`merge_readings`.

    Parameters
    ----------
    gradient, information : ndarray of float
        g and I at the most likely intensities in [0, S].
    slope : float or ndarray of float
        The derivative of the rate s of one trial by the intensity.
    rate, rate_of_information : ndarray of float
        s at these intensities, and where I was computed.
    is_dark, is_full : ndarray of bool
        Where all readings are 0, and where all are the largest one.
    threshold : int
        The threshold of the trials.

    Examples
    --------
    >>> rate, no = np.array([np.log(2)]), np.array([False])  # a trial has the information 1
    >>> ones, trials = counts_of_equal_likelihood(
    ...     np.zeros(1), np.array([8.0]), 1.0, rate, rate, is_dark=no, is_full=no
    ... )
    >>> ones.round(9).tolist(), trials.round(9).tolist()
    ([4.0], [8.0])
    """
    of_one, of_zero = _odds_of_density(threshold, rate)
    is_full = is_full & ~is_dark
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ones, trials = linear_counts(
            gradient, information, slope, rate, rate_of_information, threshold
        )
        trials = np.where(is_dark, -gradient * of_zero / slope, trials)
        trials = np.where(is_full, gradient * of_one / slope, trials)
    trials = np.minimum(np.where(trials > 0, trials, 0.0), MAX_TRIALS)
    ones = np.where(is_dark, 0.0, np.where(is_full, trials, ones))
    # Dark counts far above the threshold of the reference sensor leave no information.
    ones = np.where(trials > 0, ones, 0.0)
    return np.clip(ones, 0, trials), trials


def linear_counts(
    gradient: Array,
    information: Array,
    slope: float | Array,
    rate: Array,
    rate_of_information: Array,
    threshold: int = 1,
) -> tuple[Array, Array]:
    """Return the ones n p + g p (1 - p)/p' and the trials n = I p (1 - p)/p'².

    The parameters are those of :func:`counts_of_equal_likelihood`. The ones are a linear function
    of g, so some are below 0 or above n.

    Examples
    --------
    >>> rate = np.array([np.log(2)])
    >>> ones, trials = linear_counts(np.array([-6.0]), np.array([8.0]), 1.0, rate, rate)
    >>> ones.round(9).tolist(), trials.round(9).tolist()
    ([1.0], [8.0])
    """
    of_one, of_zero = _odds_of_density(threshold, rate_of_information)
    trials = information * of_one * of_zero / slope**2
    one = detection_probability(threshold, rate)
    step = one * _odds_of_density(threshold, rate)[1]
    return trials * one + gradient * step / slope, trials


def _odds_of_density(threshold: int, rate: Array) -> tuple[Array, Array]:
    """Return p/P' and (1 - p)/P' of the response P(q, s), 0 where P' is 0 in double precision."""
    if threshold == 1:
        return np.expm1(np.minimum(rate, _SATURATED)), np.ones(np.shape(rate))
    density = detection_density(threshold, rate)
    is_known = density > _MIN_DENSITY
    one, zero = (
        np.divide(probability(threshold, rate), density, out=np.zeros(rate.shape), where=is_known)
        for probability in (detection_probability, silence_probability)
    )
    return one, zero


def min_light(joint: JointLikelihood) -> float | Array:
    """Return the intensity of half a photon in all readings of a pixel, 0 without read noise."""
    if joint.sensor.read_noise == 0:
        return 0.0
    photons = sum(term.light * term.sum_pixels(term.trials) for term in joint.terms)
    largest = np.full(joint.shape, joint.sensor.max_intensity)
    with np.errstate(over="ignore"):
        half = np.divide(0.5, photons, out=largest.copy(), where=photons > 0)
    return np.asarray(np.minimum(half, largest))


def mean_jots(sensor: Sensor) -> tuple[float | Array, float | Array]:
    """Return the mean efficiency and the mean dark counts of the live jots of each pixel."""
    efficiency, dark_counts = (
        pixel_means(value, sensor.mask, sensor.oversampling)[0]
        for value in (sensor.efficiency, sensor.dark_counts)
    )
    return efficiency, dark_counts


def round_ones(
    ones: Array, trials: Array, *, keeps_maximum: bool | npt.NDArray[np.bool_] = False
) -> tuple[npt.NDArray[np.int32], Any]:
    """Return whole numbers of ones, and trials with the same fraction of ones.

    Less than half a one in more than twice as many trials becomes 0 in as many trials, so that the
    information stays. Where `keeps_maximum` is true, it becomes a one in more trials instead, so
    that the most likely intensity stays.

    Examples
    --------
    >>> ones, trials = np.array([0.25, 2.25]), np.array([2.0, 4.5])
    >>> [part.tolist() for part in round_ones(ones, trials)]
    [[0, 2], [2.0, 4.0]]
    >>> [part.tolist() for part in round_ones(ones, trials, keeps_maximum=True)]
    [[1, 2], [8.0, 4.0]]
    """
    fraction = np.divide(ones, trials, out=np.zeros(ones.shape), where=trials > 0)
    whole = np.rint(ones)
    least = np.where(keeps_maximum, 0.0, 0.5)
    whole = np.where((fraction > least) & (whole == 0), 1.0, whole)
    scaled = np.divide(whole, fraction, out=trials.copy(), where=(fraction > 0) & (whole > 0))
    return whole.astype(np.int32), np.maximum(scaled, whole)


def join_channels(channels: list[Merged]) -> Merged:
    """Return the merged counts of the channels of one image as those of a color image."""
    first = channels[0]
    trials = [np.broadcast_to(np.asarray(each.trials), each.shape) for each in channels]
    return dataclasses.replace(
        first,
        ones=stack_channels([each.ones for each in channels], color=True),
        trials=stack_channels(trials, color=True),
        channel_axis=-1,
    )
