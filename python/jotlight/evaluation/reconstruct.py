"""One call that estimates an image by the best method, by a named one, or by the caller's own."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Iterator
from functools import partial
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.errors import hide_warnings
from jotlight.estimators.brightness import unit_scale
from jotlight.estimators.inpaint import NO_VALID_BIT
from jotlight.evaluation.choice import Choice
from jotlight.evaluation.color.color_data import (
    BY_COLOR_NETWORK,
    check_demosaicing,
    takes_channels,
    takes_mosaic,
)
from jotlight.evaluation.color.mosaics import EstimatePlanes, reconstruct_mosaic
from jotlight.evaluation.contradictions.bright_pixels import bright_in_first_frames
from jotlight.evaluation.contradictions.clipping import warn_about_clipping
from jotlight.evaluation.contradictions.dark_counts import warn_about_dark_counts
from jotlight.evaluation.different_readings import takes_readings, with_one_response
from jotlight.evaluation.many_trials import takes_blend, trials_of
from jotlight.evaluation.methods import BLEND_METHOD, DEFAULT_METHOD
from jotlight.evaluation.own_method import OwnMethod, noting_planes, run_own
from jotlight.evaluation.records.info import Info
from jotlight.evaluation.request import AnyMethod, Request, with_network_of_module
from jotlight.evaluation.run_choice import run_choice
from jotlight.networks.loading import AnyNetwork
from jotlight.networks.network import Network
from jotlight.networks.planes_network import ColorNetwork
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import (
    Data,
    GrayImages,
    PreparedData,
    gray_images,
    prepare_data,
)
from jotlight.sensing.merged import Merged, is_finer
from jotlight.sensing.sensor import Sensor


@overload
def reconstruct(
    data: Data,
    sensor: Sensor | None = ...,
    *,
    method: AnyMethod | None = ...,
    quality: str | None = ...,
    trials: npt.ArrayLike | None = ...,
    channel_axis: int | None = ...,
    units: str = ...,
    demosaicing: str | None = ...,
    precision: str | None = ...,
    out: Image | None = ...,
    threads: int | None = ...,
    fallback: bool = ...,
    return_info: Literal[False] = ...,
    **options: Any,
) -> Image: ...
@overload
def reconstruct(
    data: Data,
    sensor: Sensor | None = ...,
    *,
    method: AnyMethod | None = ...,
    quality: str | None = ...,
    trials: npt.ArrayLike | None = ...,
    channel_axis: int | None = ...,
    units: str = ...,
    demosaicing: str | None = ...,
    precision: str | None = ...,
    out: Image | None = ...,
    threads: int | None = ...,
    fallback: bool = ...,
    return_info: Literal[True],
    **options: Any,
) -> tuple[Image, Info]: ...


def reconstruct(
    data: Data,
    sensor: Sensor | None = None,
    *,
    method: AnyMethod | None = None,
    quality: str | None = None,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    units: str = "intensity",
    demosaicing: str | None = None,
    precision: str | None = None,
    out: Image | None = None,
    threads: int | None = None,
    fallback: bool = False,
    return_info: bool = False,
    **options: Any,
) -> Image | tuple[Image, Info]:
    """Return the estimate of an image, or of each image of a stack, by the recommended method.

    Parameters
    ----------
    data : Bits, Readings, Merged, list of them, or array_like of int
        Bits, readings of several bits, merged counts, or counts L of shape (..., H, W).
    sensor : Sensor, optional
        Sensor of the data. Default: the sensor that bits or merged counts carry. Counts need it.
    method : str, Network, ColorNetwork, or callable, optional
        A name in ``jotlight.evaluation.methods.METHOD_NAMES``, a network (also a module of
        ``jotlight.torch``), or a function ``f(data, sensor)`` or ``f(data)`` that returns an
        image. Behind a mosaic, a function gets the counts (h, w) of each plane of the pattern, or
        Merged where the trials or the readings differ; it cannot replace the demosaicing.
        Default: the network "medium". With the box kernel, the default is "held-out" above 1,000
        trials per pixel, and otherwise the color network for three channels, or a mosaic. Your own
        color network takes the same data as that one.
    quality : {"two-layer", "small", "medium", "large", "extra-large"}, optional
        Size of the pretrained network to use, in place of a method.
    trials : float or array_like of float, optional
        Number of binary readings behind each pixel of counts: a number, or a map of their shape.
        Default: the sensor's K.
    channel_axis : int, optional
        Axis of counts that holds color channels. Default: none, and axes before the last two are
        those of a stack.
    units : {"intensity", "photons", "photons-per-second"}
        Units of the result: intensities; or detected photons per pixel and frame, or per pixel and
        second if the sensor states its `exposure_time`. Frames must have one gain.
    demosaicing : {"network", "menon", "differences"}, optional
        For a sensor with a mosaic: how the gray estimates of its planes become a color image
        (:func:`jotlight.estimators.demosaicing.demosaic`). "network" is the color network, which
        improves "differences" with the bits of all filters. Default: "network" if no method is
        requested and there are up to 1,000 trials per pixel; otherwise "menon" for a Bayer mosaic,
        which needs the extra `color`, and "differences" for others. "held-out" blends the color
        network with colors of planes, which this argument states.
    precision : {"f32", "bf16"}, optional
        Precision of the products of a deep network
        (:meth:`jotlight.Network.with_precision`). "bf16" is bfloat16, which is faster on processors
        with AMX, and emulated on others. Default: "f32", or that of your own network.
    out : ndarray of float32, optional
        Array of the shape of the result, which receives the result and is returned. For large
        images, this saves the time to allocate memory. Default: a new array.
    threads : int, optional
        The number of threads. Default: the number of cores.
    fallback : bool
        Whether to blend a network with total variation and maximum likelihood, with the weights
        that make held-out bits most likely (:func:`jotlight.evaluation.held_out`). It helps in
        scenes unlike photographs. Without a method, it selects "held-out", which blends the
        network "medium", and for colors the color network, too. This takes 10 to 30 times as long.
        With `return_info`, `Info.shares` holds the mean weight of each method.
    return_info : bool
        Whether to also return which method was chosen and why.
    **options
        Options of the method, such as ``weight`` of "admm-tv". Without `method`, an option selects
        the method to which it belongs.

    Returns
    -------
    ndarray of float32
        Intensities, or photons as `units` states, of the shape of the counts. Estimates of color
        bits are (H, W, C), and those of mosaics (..., H, W, 3).
    Info
        Only with `return_info`.

    Raises
    ------
    TypeError, ValueError
        When the data, their sensor, the method, its options, or `out` do not fit together.

    Warns
    -----
    JotlightWarning
        When the data show that pixels are brighter than the largest intensity S, which clips their
        estimates, although the bits saturate beyond it; and when the data have fewer ones than the
        dark counts of the sensor cause without light.
    PeriodicRatesWarning
        When the rates of jots repeat, as under a color filter mosaic. All methods warn about it.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=2, frames=4)
    >>> bits = sensor.expose(jl.datasets.photograph("camera")[::8, ::8], rng=0)
    >>> jl.reconstruct(bits).shape
    (64, 64)
    >>> _, info = jl.reconstruct(bits.counts(), sensor, method="mle", return_info=True)
    >>> info.title, info.reason
    ('maximum likelihood', 'requested')
    >>> timed = sensor.replace(exposure_time=1e-5)
    >>> photons = jl.reconstruct(bits.counts(), timed, method="mle", units="photons-per-second")
    """
    if "return_history" in options:
        raise TypeError("return_history: pass return_info=True, and take the history of the info")
    method = with_network_of_module(method)
    if sensor is None and isinstance(method, Network):
        sensor = method.sensor_of(data, trials)
    request = Request(method, quality, demosaicing, precision, fallback, options, threads)
    declared = carried_sensor(data) if sensor is None else sensor
    if isinstance(declared, Sensor) and declared.mosaic is not None:
        scale = np.float32(unit_scale(declared, units))
        colors, info = _of_mosaic(
            request, data, declared, trials=trials, channel_axis=channel_axis, out=out
        )
        colors *= scale
        return (colors, info) if return_info else colors
    data, sensor = prepare_data(data, sensor, trials, channel_axis, may_differ=True)
    check_demosaicing(demosaicing, sensor)
    scale = np.float32(unit_scale(sensor, units, data))
    if callable(method) and not isinstance(method, AnyNetwork):
        estimate, info = _by_function(method, request, data, sensor, out)
    else:
        with _without_warnings_of_colors(data):
            images = gray_images(data)
            estimate, info = _by_method(request, images, sensor, out)
        bright = partial(bright_in_first_frames, images, sensor, threads)
        warn_about_clipping(estimate, sensor, bright, images.data)
        warn_about_dark_counts(images, sensor, threads)
    if scale != 1:
        # A function of the caller may return an array that it still needs.
        is_own = out is not None or isinstance(method, str | AnyNetwork | None)
        estimate = np.multiply(estimate, scale, out=estimate if is_own else None)
    return (estimate, info) if return_info else estimate


def _of_mosaic(request: Request, data: Data, sensor: Sensor, **arrays: Any) -> tuple[Image, Info]:
    """Return the colors of a mosaic by a color network, or by a method for each plane."""
    method, demosaicing = request.method, request.demosaicing
    has_form = takes_mosaic(data, arrays["trials"])
    network = method if isinstance(method, ColorNetwork) else None
    estimate: EstimatePlanes | Choice | None = _choice_of_colors(request, sensor, has_form=has_form)
    if estimate is None:
        of_planes = dataclasses.replace(request, demosaicing=None).arguments()
        run = noting_planes(method, partial(reconstruct, **of_planes))
        estimate = partial(run, return_info=True)
    return reconstruct_mosaic(
        data,
        sensor,
        estimate,
        network=network,
        demosaicing=None if demosaicing == BY_COLOR_NETWORK else demosaicing,
        precision=request.precision,
        threads=request.threads,
        **arrays,
    )


def _choice_of_colors(request: Request, sensor: Sensor, *, has_form: bool) -> Choice | None:
    """Return the choice of a method that estimates the colors of a mosaic, or None for planes."""
    choice = request.choose_unless_own(sensor, takes_colors=has_form)
    if choice is None or choice.is_color or isinstance(request.method, ColorNetwork):
        return choice
    return None


def _by_function(
    function: OwnMethod,
    request: Request,
    data: PreparedData,
    sensor: Sensor,
    out: Image | None,
) -> tuple[Image, Info]:
    """Return the estimate of a function of the caller, and how it was made."""
    start = time.perf_counter()
    request.choose_unless_own(sensor, takes_colors=False)
    output = output_of(gray_images(data), sensor, out)
    estimate = output.deliver(run_own(function, data, sensor, request.threads, request.options))
    name = str(getattr(function, "__name__", type(function).__name__))
    return estimate, Info(name, name, "requested", time.perf_counter() - start)


@contextlib.contextmanager
def _without_warnings_of_colors(data: object) -> Iterator[None]:
    """Hide the warning about dead pixels, if each pixel has bits of at least one color.

    In counts that were merged along a motion behind a mosaic, a pixel may lack the bits of a color.
    It is not dead.
    """
    are_known = (
        isinstance(data, Merged)
        and data.ones.ndim == 3
        and np.broadcast_to(data.trials, data.shape).any(axis=2).all()
    )
    with hide_warnings(NO_VALID_BIT) if are_known else contextlib.nullcontext():
        yield


def _by_method(
    request: Request, images: GrayImages, sensor: Sensor, out: Image | None
) -> tuple[Image, Info]:
    """Return the estimate of a network or of one of jotlight's methods, and how it was made."""
    method, threads = request.method, request.threads
    requested = request.name()
    network = method if isinstance(method, AnyNetwork) else None
    if requested is None and any(is_finer(each) for each in images.data):
        requested = DEFAULT_METHOD
        request = dataclasses.replace(request, method=network or requested)
    start = time.perf_counter()
    are_equivalent, trials = not takes_readings(requested, sensor), trials_of(sensor)
    if are_equivalent:
        is_blend = requested is None and takes_blend(sensor, trials)
        by = network or (BLEND_METHOD if is_blend else requested)
        images, sensor = with_one_response(images, sensor, by, threads, keeps_maximum=True)
    choice = request.choose(sensor, takes_colors=takes_channels(images), trials=trials)
    # Equivalent counts have different numbers of trials, which only some networks take.
    estimate, *ending = run_choice(
        choice, request, images, sensor, out, network=network, is_conditional=are_equivalent
    )
    seconds = time.perf_counter() - start
    return estimate, Info(choice.method, choice.title, choice.reason, seconds, *ending)
