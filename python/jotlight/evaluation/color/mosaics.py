"""Color estimates of sensors with a mosaic: by the color network, or planes and demosaicing."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.estimators.demosaicing import (
    TITLES,
    check_installed,
    choose_demosaicing,
    demosaic,
)
from jotlight.evaluation.choice import Choice
from jotlight.evaluation.color.color_images import count_image
from jotlight.evaluation.color.mosaic_blend import blend_mosaic
from jotlight.evaluation.contradictions.bright_pixels import bright_behind_mosaic
from jotlight.evaluation.contradictions.clipping import largest_colors, warn_about_clipping
from jotlight.evaluation.methods import BLEND_METHOD
from jotlight.evaluation.records.info import Info, join_infos
from jotlight.layout import Layout
from jotlight.networks.color.color_inference import estimate_mosaic
from jotlight.networks.color.mosaic_planes import estimate_values
from jotlight.networks.planes_network import ColorNetwork
from jotlight.networks.pretrained import (
    COLOR_START,
    MOSAIC_FILE,
    pretrained_color,
    pretrained_conditional,
)
from jotlight.sensing.bits.output_images import OutputImages
from jotlight.sensing.data.pixel_counts import Data, PixelCounts, gray_images, prepare_data
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.sensor import Sensor

EstimatePlanes = Callable[[Any, Sensor], tuple[Image, Info]]
"""A function from the data of gray planes and their sensor to their estimates (N, h, w), and how
these were made."""


def reconstruct_mosaic(
    data: Data,
    sensor: Sensor,
    estimate: EstimatePlanes | Choice,
    *,
    network: ColorNetwork | None = None,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    demosaicing: str | None = None,
    precision: str | None = None,
    out: Image | None = None,
    threads: int | None = None,
) -> tuple[Image, Info]:
    """Return the colors of the image of a mosaic, or of each image of a stack.

    Parameters
    ----------
    data : Bits, Readings, Merged, list of them, or array_like of int
        The data, as of :func:`jotlight.reconstruct`. The pixels are those of the mosaic.
    sensor : Sensor
        Their sensor, with a mosaic.
    estimate : callable or Choice
        ``estimate(planes, sensor)`` returns the estimates of gray planes, (N, h, w), and how they
        were made. A choice is that of a color network, or of the blend on held-out bits.
    network : ColorNetwork, optional
        The color network of the caller. Default: the pretrained one.
    trials, channel_axis, out, threads
        As of :func:`jotlight.reconstruct`.
    demosaicing : {"menon", "differences"}, optional
        How the planes become colors. Default: as of
        :func:`jotlight.estimators.demosaicing.demosaic`.
    precision : {"f32", "bf16"}, optional
        Precision of the color network. Default: its own.

    Returns
    -------
    ndarray of float32, shape (..., H, W, 3)
        Red, green, and blue from 0 to S times the white balance.
    Info
        How the colors were made, with the time of everything.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together.

    Examples
    --------
    >>> from functools import partial
    >>> sensor = jl.Sensor(frames=10_000, mosaic="RGBW", max_intensity=2.0)
    >>> bits = sensor.expose(np.full((8, 8, 3), [0.3, 0.2, 0.1]), rng=0)
    >>> estimate = partial(jl.reconstruct, method="mle", return_info=True)
    >>> colors, info = reconstruct_mosaic(bits, sensor, estimate)
    >>> colors.mean(axis=(0, 1)).round(2), info.title
    (array([0.3, 0.2, 0.1], dtype=float32), 'maximum likelihood, color differences')
    """
    start = time.perf_counter()
    mosaic: Mosaic = sensor.mosaic
    method = choose_demosaicing(mosaic, demosaicing)
    prepared, gray = prepare_data(
        data, sensor, trials, channel_axis, may_differ=True, takes_mosaics=True
    )
    images = gray_images(prepared)
    if images.layout.channel_axis is not None:
        raise ValueError(
            "data: expected gray bits or counts, because the pixels of a mosaic have one color "
            "each, got color channels; sensor.replace(mosaic=None) is a sensor of color channels"
        )
    if not isinstance(estimate, Choice) or estimate.method == BLEND_METHOD:
        check_installed(method)
    counted = [count_image(one, gray, threads, mosaic) for one in images.data]
    output = OutputImages(Layout((*images.layout.shape, 3), -1), counted[0].counts.shape, out)
    if not isinstance(estimate, Choice):
        colors, info = _by_planes(counted, mosaic, estimate, method)
    elif estimate.method == BLEND_METHOD:
        colors, info = _by_blend(counted, mosaic, estimate, method, threads)
    else:
        network = network or pretrained_color(MOSAIC_FILE)
        network = network if precision is None else network.with_precision(precision)
        colors, info = _by_color_network(counted, mosaic, gray, network, estimate, threads)
    if isinstance(estimate, Choice):
        # The estimates of planes warn by themselves.
        bright = partial(bright_behind_mosaic, counted, mosaic)
        warn_about_clipping(np.stack(colors), sensor, bright)
    largest = largest_colors(sensor)
    for each in colors:
        np.clip(each, 0, largest, out=each)
    info = dataclasses.replace(info, seconds=time.perf_counter() - start)
    return output.finish(np.concatenate([np.moveaxis(each, -1, 0) for each in colors])), info


def _by_color_network(
    counted: Sequence[PixelCounts],
    mosaic: Mosaic,
    gray: Sensor,
    network: ColorNetwork,
    choice: Choice,
    threads: int | None,
) -> tuple[list[Image], Info]:
    """Return the colors of each image by a color network, and how they were made.

    The gray network at which it starts has its precision. The caller sets the computing time.
    """
    start = pretrained_conditional(gray, COLOR_START).with_precision(network.precision)
    colors = [estimate_mosaic(network, start, each, mosaic, threads) for each in counted]
    return colors, Info(choice.method, choice.title, choice.reason)


def _by_blend(
    counted: Sequence[PixelCounts], mosaic: Mosaic, choice: Choice, method: str, threads: int | None
) -> tuple[list[Image], Info]:
    """Return the colors of each image by the blend of the color network with other methods.

    The other result is how they were made. The caller sets the computing time.
    """
    colors: list[Image] = []
    infos: list[Info] = []
    for each in counted:
        blended, shares = blend_mosaic(each, mosaic, method, threads)
        colors.append(blended)
        infos.append(Info(choice.method, choice.title, choice.reason, shares=shares))
    return colors, join_infos(infos, TITLES[method])


def _by_planes(
    counted: Sequence[PixelCounts], mosaic: Mosaic, estimate: EstimatePlanes, method: str
) -> tuple[list[Image], Info]:
    """Return the colors of each image by estimates of gray planes and a demosaicing method.

    The other result is how they were made. The caller sets the computing time.
    """
    colors: list[Image] = []
    infos: list[Info] = []
    for each in counted:
        values, weights, infos_of_one = estimate_values(each, mosaic, estimate)
        colors.append(demosaic(values, mosaic, method, weights).astype(np.float32))
        infos += infos_of_one
    return colors, join_infos(infos, TITLES[method])
