"""Videos as lazy arrays: an estimate of each of many windows of frames."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from jotlight.dask.pieces import Pieces, check_packed_array
from jotlight.networks.network import Network
from jotlight.runs.chunk_counting import estimate_tile
from jotlight.runs.estimator import check_countable, choose_estimator
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.sensor import Sensor

if TYPE_CHECKING:
    import dask.array

_MAX_PIXELS = 1 << 22
"""Maximum number of pixels of an image that is not divided into tiles."""

_TILE = 1024
"""Maximum side of a tile in pixels."""


def reconstruct(
    x: "Bits | dask.array.Array",
    sensor: Sensor | None = None,
    window: int | None = None,
    step: int | None = None,
    *,
    method: str | Network | None = None,
    quality: str | None = None,
    demosaicing: str | None = None,
    precision: str | None = None,
    width: int | None = None,
    **options: Any,
) -> "dask.array.Array":
    """Return a video, an estimate of each window of frames, as a lazy array.

    Parameters
    ----------
    x : Bits or dask.array.Array of uint8, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
        Bits, or packed bits as :meth:`jotlight.Bits.to_dask` returns them.
    sensor : Sensor, optional
        Sensor of the data; its number of frames becomes that of a window. Default: the sensor of
        the bits.
    window : int, optional
        Number of frames of an image. Default: all.
    step : int, optional
        Frames from one window to the next. Default: the size of a window.
    method : str or Network, optional
        A name in ``jotlight.evaluation.methods.METHODS``, or a network. Default: the recommended
        method for the sensor, which is the color network for a mosaic and for three channels, as in
        :func:`jotlight.reconstruct`.
    quality : {"two-layer", "small", "medium", "large", "extra-large"}, optional
        Size of a pretrained network, in place of a method.
    demosaicing : {"network", "menon", "differences"}, optional
        For a sensor with a mosaic: how planes become colors, as in :func:`jotlight.reconstruct`.
    precision : {"f32", "bf16"}, optional
        Precision of the products of a deep network, as in :func:`jotlight.reconstruct`.
    width : int, optional
        W: the true width in jots, such as ``bits.width``. An array of packed bits needs it, because
        its rows are padded to whole bytes. Default: that of the bits.
    **options
        Options of the method, such as `weight`.

    Returns
    -------
    dask.array.Array of float32, shape (N, H / K̂, W / K̂) or (N, H / K̂, W / K̂, C)
        Intensities in [0, S]. Those of a mosaic are (N, H / K̂, W / K̂, 3): red, green, and blue.

    Raises
    ------
    MissingExtraError
        When dask is not installed.
    TypeError, ValueError
        When the data, their sensor, the method, and its options do not fit together.

    Warns
    -----
    JotlightWarning
        When the array is computed, as of :func:`jotlight.reconstruct`, if the first image of a task
        contradicts the sensor. To compare all images may take longer than their estimates.

    Notes
    -----
    The method gets the counts of each window. Images of more than 4 Mpixel are divided into tiles
    of at most 1024 x 1024 pixels if each pixel is estimated by itself: by "mle", for a sensor
    without maps and mosaic. Other methods get the whole image.

    Examples
    --------
    >>> bits = jl.Sensor(frames=64).expose(np.full((16, 16), 0.5), rng=0)
    >>> jl.dask.reconstruct(bits, window=16, method="mle").shape
    (4, 16, 16)
    >>> sensor = jl.Sensor(frames=64, mosaic="RGGB")
    >>> bits = sensor.expose(np.full((16, 16, 3), 0.5), rng=0)
    >>> jl.dask.reconstruct(bits, window=16).shape
    (4, 16, 16, 3)
    """
    if not isinstance(x, Bits):
        check_packed_array(x)
    elif sensor is None:
        sensor = x.sensor
    if sensor is None:
        raise TypeError(
            "sensor: expected a jotlight.Sensor, because these bits carry none; pass the sensor "
            "that recorded them, such as Sensor(frames=16)"
        )
    check_countable(sensor)
    window = int(x.shape[0]) if window is None else window
    estimator = choose_estimator(
        sensor.replace(frames=window),
        method,
        quality,
        options,
        demosaicing=demosaicing,
        precision=precision,
        channels=x.shape[3] if len(x.shape) == 4 else 1,
    )
    pieces = Pieces.of(
        x,
        window,
        step,
        oversampling=sensor.oversampling,
        width=width,
        is_fast=estimator.has_table,
    )
    sensor.check_map_shapes(*(size * sensor.oversampling for size in pieces.image_shape[:2]))
    if not (estimator.is_pixelwise and math.prod(pieces.image_shape[:2]) > _MAX_PIXELS):
        return pieces.estimate(estimator)
    counts = pieces.count().rechunk({1: _TILE, 2: _TILE})
    meta = np.empty((0,) * counts.ndim, np.float32)
    return counts.map_blocks(estimate_tile, estimator, dtype=np.float32, meta=meta)
