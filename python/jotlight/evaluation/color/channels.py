"""Color estimates of images with three counts per pixel, by the color network."""

import contextlib
import time
from collections.abc import Iterator

import numpy as np

from jotlight.array_types import Image
from jotlight.errors import hide_warnings
from jotlight.estimators.inpaint import NO_VALID_BIT
from jotlight.evaluation.choice import OWN_NETWORK, TITLES
from jotlight.evaluation.color.color_data import check_taken, takes_channels
from jotlight.evaluation.color.color_images import reconstruct_channels
from jotlight.evaluation.records.info import Info
from jotlight.networks.color_network import ColorNetwork
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor


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
