"""The uncertainty of each pixel of the estimate of any method."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from jotlight.checks import real_number, shown
from jotlight.errors import percent_advice
from jotlight.estimators.brightness import unit_scale
from jotlight.estimators.readings.joint_uncertainty import joint_uncertainty
from jotlight.estimators.readings.typical_trials import typical_trials
from jotlight.estimators.uncertainty import Uncertainty, exact_uncertainty
from jotlight.evaluation.color.color_data import (
    takes_channels,
    takes_mosaic,
)
from jotlight.evaluation.contradictions.bright_pixels import bright_in_first_frames, bright_pixels
from jotlight.evaluation.contradictions.clipping import warn_about_clipping
from jotlight.evaluation.different_readings import with_one_response, with_saturation
from jotlight.evaluation.intervals.channel_intervals import find_channel_intervals
from jotlight.evaluation.intervals.color_intervals import (
    check_color_errors_known,
    mosaic_uncertainty,
)
from jotlight.evaluation.intervals.intervals import find_intervals
from jotlight.evaluation.intervals.known_estimate import read_estimate
from jotlight.evaluation.intervals.measured_networks import reference_network
from jotlight.evaluation.intervals.widened_intervals import widen_intervals
from jotlight.evaluation.many_trials import trials_of
from jotlight.evaluation.methods import COLOR_NETWORK
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.request import AnyMethod, Request, with_network_of_module
from jotlight.parameter_names import other_names
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.data.pixel_counts import Data, GrayImages, gray_images, prepare_data
from jotlight.sensing.sensor import Sensor

EXACT_METHOD = "mle"
"""Name of the method whose intervals are exact."""


@other_names(
    level="confidence_level= for the coverage of the intervals",
    confidence="confidence_level= for the coverage of the intervals",
    model="method= for a network",
    network="method= for a network",
)
def uncertainty(
    data: Data,
    sensor: Sensor | None = None,
    *,
    method: AnyMethod | None = None,
    quality: str | None = None,
    estimate: npt.ArrayLike | None = None,
    confidence_level: float = 0.95,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    units: str = "intensity",
    demosaicing: str | None = None,
    precision: str | None = None,
    fallback: bool = False,
    threads: int | None = None,
) -> Uncertainty:
    """Return the standard error and an interval of the intensity for each pixel of an estimate.

    Parameters
    ----------
    data : Bits, Readings, Merged, list of them, or array_like of int
        Bits, readings of several bits, merged counts, or counts L of shape (..., H, W).
    sensor : Sensor, optional
        The sensor that recorded the data, as for `jotlight.reconstruct`.
    method : str, Network, or callable, optional
        The method of the estimate, as for `jotlight.reconstruct`, with the same default.
    quality : {"two-layer", "small", "medium", "large", "extra-large"}, optional
        The size of a pretrained network, in place of a method.
    estimate : array_like of float, optional
        The method's estimate in units of intensity, if it is known. Default: it is computed. The
        intervals of "mle" depend on the data alone.
    confidence_level : float
        The coverage of the intervals, in [0.5, 1).
    trials : float or array_like of float, optional
        The number of binary readings behind each pixel of counts, 0 or more: a number, or a map of
        their shape. Default: the sensor's K.
    channel_axis : int, optional
        The axis of counts that holds color channels. Default: none, and axes before the last two
        are those of a stack.
    units : {"intensity", "photons", "photons-per-second"}
        The units of the result, as for `jotlight.reconstruct`.
    demosaicing : {"network", "menon", "differences"}, optional
        For a sensor with a mosaic: how planes become colors, as for `jotlight.reconstruct`.
    precision : {"f32", "bf16"}, optional
        The precision of the products of a deep network whose estimate is computed, as for
        `jotlight.reconstruct`.
    fallback : bool
        Whether the estimate is a blend of the network with other methods, as for
        `jotlight.reconstruct`.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    Uncertainty
        Arrays of the shape of the estimate.

    Raises
    ------
    TypeError, ValueError
        When data, sensor, trials, and estimate do not fit together, the confidence level is out of
        range, or the kernel is smooth (except for "mle").

    Warns
    -----
    JotlightWarning
        For the method "mle", when the kernel is smooth. The interval is then that of the mean light
        on the pixel's jots. When the data show that pixels are brighter than the largest intensity
        S, at which intervals end, although the bits saturate beyond it. These pixels are marked as
        saturated.

    Notes
    -----
    For "mle", each interval is exact: that of Clopper and Pearson. Its coverage is at least
    `confidence_level` for any number of bits and any intensity in [0, S]. If gains or thresholds
    differ, it is the exact interval of the total number of ones, and for readings of several bits
    that of the sum of the readings. There are three exceptions, for which the coverage is only
    approximate: sums above 1,024; live pixels of more than 64 kinds, which occur only if the jots
    of a pixel differ, or with a map of dark counts together with different gains
    (:func:`jotlight.estimators.readings.joint_uncertainty.joint_uncertainty`); and equivalent
    counts, as of `jotlight.merge_readings`. Pass the readings instead, and take
    `jotlight.FreeRunning.interval` for counts with a dead time.

    For other methods, the coverage is an average over the pixels of photographs (conformal
    prediction), and `docs/results/uncertainty.md` states it for many cases. The errors of "medium",
    "large", and "extra-large" have been measured on photographs, depending on brightness, local
    activity, and K. From four trials per pixel, the data correct them: the bits are divided into
    two random halves, and the estimates from one half are compared with the other. For all other
    methods and networks, the squared difference from the estimate of "medium" is added, and for a
    blend of one of these three (`fallback`), that from the estimate of this network. Where readings
    tell less about other light than about the estimate, their intervals are wider.

    Behind a mosaic, the errors of the color network replace those of the gray networks. There may
    be up to 1,000 trials per pixel.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=100, max_intensity=10.0)
    >>> result = jl.uncertainty(np.array([[0, 50, 100]]), sensor, method="mle")
    >>> result.standard_error.round(3)
    array([[0.007, 0.1  , 1.411]], dtype=float32)
    >>> result.low.round(2), result.high.round(2)
    (array([[0.  , 0.51, 3.32]], dtype=float32), array([[ 0.04,  0.92, 10.  ]], dtype=float32))
    >>> result.flags().tolist()
    [[1, 0, 2]]
    >>> image = jl.datasets.photograph("camera")[100:200, 200:300]
    >>> result = jl.uncertainty(jl.Sensor(frames=16).expose(image, rng=0), confidence_level=0.9)
    >>> bool(0.8 < ((result.low <= image) & (image <= result.high)).mean() < 0.99)
    True
    """
    if not 0.5 <= (level := real_number(confidence_level)) < 1:
        raise ValueError(
            "confidence_level: expected a coverage from 0.5 to below 1, got "
            f"{shown(confidence_level)}{percent_advice(level, 0.5)}"
        )
    method = with_network_of_module(method)
    request = Request(method, quality, demosaicing, precision, fallback, threads=threads)
    stated = carried_sensor(data) if sensor is None else sensor
    if isinstance(stated, Sensor) and stated.mosaic is not None:
        choice = request.choose_unless_own(stated, takes_colors=takes_mosaic(data, trials))
        scale = unit_scale(stated, units)

        def colors() -> npt.ArrayLike:
            if estimate is not None:
                return estimate
            run: Callable[..., npt.ArrayLike] = partial(reconstruct, **request.arguments())
            return run(data, stated, trials=trials, channel_axis=channel_axis)

        found = mosaic_uncertainty(
            data,
            stated,
            colors,
            is_own=choice is not None and choice.method == COLOR_NETWORK,
            confidence_level=confidence_level,
            trials=trials,
            channel_axis=channel_axis,
            threads=threads,
        )
        return found.scaled(scale)
    data, sensor = prepare_data(data, sensor, trials, channel_axis, may_differ=True)
    scale = unit_scale(sensor, units, data)
    images = gray_images(data)
    request.choose_unless_own(sensor, takes_colors=takes_channels(images))
    if estimate is not None:
        shape = images.layout.shape_of(images.size(sensor))
        estimate = read_estimate(estimate, shape, sensor.max_intensity)
    found = _of_gray_images(images, sensor, request, estimate, confidence_level)
    return _with_bright_pixels(found, images, sensor, request).scaled(scale)


def _of_gray_images(
    images: GrayImages,
    sensor: Sensor,
    request: Request,
    estimate: npt.ArrayLike | None,
    confidence_level: float,
    trials: float | None = None,
) -> Uncertainty:
    """Return the uncertainty of the estimates of gray images, in units of intensity.

    Without an estimate, it is computed. For equivalent counts, `trials` is the number of trials by
    which the method was chosen: that of the readings.
    """
    method, quality, threads = request.method, request.quality, request.threads
    if method == EXACT_METHOD:
        find = exact_uncertainty if sensor.has_plain_bits else joint_uncertainty
        return find(images, sensor, confidence_level, threads)
    if not sensor.has_plain_bits:
        if estimate is None:
            estimate = reconstruct(images, sensor, **request.arguments())
        merged, reference = with_one_response(images, sensor, method, threads)
        found = _of_gray_images(
            merged, reference, request, estimate, confidence_level, trials_of(sensor)
        )
        found = widen_intervals(found, np.asarray(estimate), sensor)
        return with_saturation(found, images, sensor, threads)
    check_errors_known(method, sensor)
    if estimate is None:
        estimate = reconstruct(images, sensor, **request.arguments())
    values = np.ascontiguousarray(images.layout.split(np.asarray(estimate, np.float32)))
    if request.is_default or method == COLOR_NETWORK:
        choice = request.choose(sensor, takes_colors=takes_channels(images), trials=trials)
        if choice.method == COLOR_NETWORK:
            return find_channel_intervals(
                images, values, sensor, confidence_level=confidence_level, threads=threads
            )
        quality = choice.quality
    network, is_own = reference_network(method, quality, sensor)
    return find_intervals(
        images,
        values,
        sensor,
        network,
        is_own=is_own and not request.fallback,
        confidence_level=confidence_level,
        threads=threads,
    )


def _with_bright_pixels(
    found: Uncertainty, images: GrayImages, sensor: Sensor, request: Request
) -> Uncertainty:
    """Return the uncertainty, with pixels that are brighter than S as saturated.

    For maximum likelihood, warn about them. The estimates of other methods warn by themselves.
    """
    if float(found.high.max()) < np.float32(sensor.max_intensity):
        return found
    if request.method == EXACT_METHOD:
        bright = partial(bright_in_first_frames, images, sensor, request.threads)
        warn_about_clipping(found.high, sensor, bright, images.data)
        return found  # exact intervals show it by themselves
    if (brighter := bright_pixels(images, sensor, request.threads)) is None:
        return found
    saturated = found.saturated | images.layout.arrange(brighter)
    return dataclasses.replace(found, saturated=saturated)


def check_errors_known(method: AnyMethod | None, sensor: Sensor) -> None:
    """Raise ValueError if :func:`uncertainty` has no intervals of a method for a sensor.

    Examples
    --------
    >>> check_errors_known("mle", jl.Sensor(kernel="cubic"))
    >>> check_errors_known(None, jl.Sensor(kernel="cubic"))
    Traceback (most recent call last):
      ...
    ValueError: sensor: expected the box kernel, got cubic: ...
    >>> check_errors_known(None, jl.Sensor(frames=1001, mosaic="RGGB"))
    Traceback (most recent call last):
      ...
    ValueError: data: expected up to 1,000 trials per pixel, because ...
    """
    if sensor.mosaic is not None:
        check_color_errors_known(typical_trials(sensor))
    if method != EXACT_METHOD and sensor.kernel != "box":
        raise ValueError(
            f"sensor: expected the box kernel, got {sensor.kernel}: the errors of its estimates "
            f'are unknown; method="{EXACT_METHOD}" (--method {EXACT_METHOD}) has intervals of the '
            "mean light of each pixel"
        )
