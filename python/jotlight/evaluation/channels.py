"""Color estimates of images with three counts per pixel, by the color network."""

import contextlib
import time
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from jotlight.errors import hide_warnings
from jotlight.estimators.demosaicing import COLORS
from jotlight.estimators.inpaint import NO_VALID_BIT
from jotlight.evaluation.choice import OWN_NETWORK, TITLES
from jotlight.evaluation.color_data import check_taken, takes_channels
from jotlight.evaluation.info import Info
from jotlight.evaluation.mosaics import count_image
from jotlight.networks.color_inference import estimate_channels
from jotlight.networks.color_network import ColorNetwork
from jotlight.networks.pretrained import (
    CHANNELS_FILE,
    COLOR_START,
    pretrained_color,
    pretrained_conditional,
)
from jotlight.sensing.gray_outputs import output_of
from jotlight.sensing.merged import Merged
from jotlight.sensing.pixel_counts import GrayImages
from jotlight.sensing.sensor import Sensor

Image = npt.NDArray[np.float32]


@contextlib.contextmanager
def without_warnings_of_colors(data: object) -> Iterator[None]:
    """Hide the warning about dead pixels, if each pixel has bits of at least one color.

    In counts that were merged along a motion behind a mosaic, a pixel may lack the bits of a color.
    It is not dead.

    Examples
    --------
    >>> with without_warnings_of_colors(None):
    ...     pass
    """
    are_known = (
        isinstance(data, Merged)
        and data.ones.ndim == 3
        and np.broadcast_to(data.trials, data.shape).any(axis=2).all()
    )
    with hide_warnings(NO_VALID_BIT) if are_known else contextlib.nullcontext():
        yield


def run_color_network(
    network: ColorNetwork,
    images: GrayImages,
    sensor: Sensor,
    out: Image | None,
    threads: int | None,
    precision: str | None = None,
) -> tuple[Image, Info]:
    """Return red, green, and blue of images by a color network of the caller, and how.

    Raises
    ------
    ValueError
        When the images do not have three channels of bits.
    """
    check_taken(sensor, has_form=takes_channels(images))
    start = time.perf_counter()
    estimate = reconstruct_channels(images, sensor, out, threads, network, precision)
    seconds = time.perf_counter() - start
    return estimate, Info(OWN_NETWORK, TITLES[OWN_NETWORK], "requested", seconds)


def reconstruct_channels(
    images: GrayImages,
    sensor: Sensor,
    out: object,
    threads: int | None,
    network: ColorNetwork | None = None,
    precision: str | None = None,
) -> Image:
    """Return red, green, and blue of images with three counts per pixel.

    Parameters
    ----------
    images : GrayImages
        The channels of all images. :func:`jotlight.evaluation.color_data.takes_channels` states
        which.
    sensor : Sensor
        Their sensor, with plain bits.
    out : ndarray of float32, optional
        As for :func:`jotlight.reconstruct`.
    threads : int, optional
        The number of threads. Default: the number of cores.
    network : ColorNetwork, optional
        Default: the pretrained one for channels.
    precision : {"f32", "bf16"}, optional
        Precision of the networks. Default: that of the color network.

    Examples
    --------
    >>> from jotlight.layout import Layout
    >>> images = GrayImages(np.full((3, 8, 8), 8, np.int32), Layout((3,), -1))
    >>> reconstruct_channels(images, jl.Sensor(frames=16), None, None).shape
    (8, 8, 3)
    """
    network = network or pretrained_color(CHANNELS_FILE)
    network = network if precision is None else network.with_precision(precision)
    gray = pretrained_conditional(sensor, COLOR_START).with_precision(network.precision)
    output = output_of(images, sensor, out)
    for start in range(0, len(images), COLORS):
        colors = slice(start, start + COLORS)
        channels = [count_image(one, sensor, threads) for one in images.data[colors]]
        output.images[colors] = estimate_channels(network, gray, channels, threads)
    return output.finish(output.images)
