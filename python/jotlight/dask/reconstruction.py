"""Videos as lazy arrays: an estimate of each of many windows of frames."""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.dask.counting import count
from jotlight.evaluation.choice import OWN_NETWORK, choose_method, requested_method
from jotlight.evaluation.methods import METHODS, check_options
from jotlight.layout import Layout
from jotlight.networks.architectures import SIZES
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained
from jotlight.sensing.bits import Bits
from jotlight.sensing.pixel_counts import GrayImages
from jotlight.sensing.sensor import Sensor, require_sensor

if TYPE_CHECKING:
    import dask.array

_MAX_PIXELS = 1 << 22
"""Maximum number of pixels of an image that is not divided into tiles."""

_TILE = 1024
"""Maximum side of a tile, in pixels. Tiles depend on the size of the image only, not on chunks."""


@dataclasses.dataclass(frozen=True)
class Estimator:
    """A method with its sensor, which estimates images from counts. Workers get copies of it."""

    sensor: Sensor
    method: str
    """Key of :data:`METHODS`, or :data:`OWN_NETWORK`."""
    network: Network | None = None
    options: tuple[tuple[str, Any], ...] = ()

    @property
    def halo(self) -> int | None:
        """Radius in pixels on which a pixel of the estimate depends. None: on the whole image."""
        maps = any(isinstance(value, np.ndarray) for value in self.sensor.maps().values())
        if maps:
            return None
        if self.network is not None:
            return self.network.halo
        return 0 if self.method == "mle" else None

    def __call__(self, counts: npt.NDArray[np.int32]) -> npt.NDArray[np.float32]:
        """Return the estimates of counts (N, H, W) or (N, H, W, C). One thread computes them."""
        channels = counts.shape[3:]
        if counts.size == 0:
            return np.empty(counts.shape, np.float32)
        if channels:
            # The layout (N, C) has the channels as the last axis of the result.
            gray = np.ascontiguousarray(np.moveaxis(counts, -1, 1)).reshape(-1, *counts.shape[1:3])
            layout = Layout((len(counts), *channels), -1)
        else:
            gray, layout = np.ascontiguousarray(counts), Layout((len(counts),))
        images = GrayImages(gray, layout)
        if self.network is not None:
            return self.network.reconstruct(images, self.sensor, threads=1)
        run, options = METHODS[self.method].run, dict(self.options)
        return np.asarray(run(images, self.sensor, threads=1, **options))


def choose_estimator(
    sensor: Sensor,
    method: str | Network | None = None,
    quality: str | None = None,
    options: dict[str, Any] | None = None,
) -> Estimator:
    """Return the recommended method for counts of a sensor, or the requested one.

    Raises
    ------
    TypeError, ValueError
        When the method, its options, and the sensor do not fit together.

    Examples
    --------
    >>> choose_estimator(Sensor(frames=16), quality="small").method
    'network-small'
    """
    options = options or {}
    network = method if isinstance(method, Network) else None
    if quality is not None:
        if method is not None:
            raise ValueError(f"quality: selects a shipped network, but method is {method!r}")
        if quality not in SIZES:
            raise ValueError(f"quality: expected one of {', '.join(SIZES)}, got {quality!r}")
        method = f"network-{quality}"
    if method is not None and network is None and not isinstance(method, str):
        raise TypeError(f"method: expected the name of a method, or a network, got {method!r}")
    if network is not None and options:
        raise ValueError(f"{next(iter(options))}: is not an option of a network; leave it out")
    requested = None if network is not None else requested_method(method, list(options))  # type: ignore[arg-type]
    if requested is not None:
        check_options(requested, options)
    if sensor.oversampling > 1 and sensor.maps():
        raise ValueError(
            "sensor: expected one without maps of its jots, because counts of pixels of "
            f"{sensor.oversampling} x {sensor.oversampling} jots do not say which jots reported 1; "
            "use oversampling=1 (--oversampling 1)"
        )
    choice = choose_method(sensor, requested=requested, network=network, is_bits=False)
    if choice.quality is not None:
        network = pretrained(sensor, choice.quality)
    name = OWN_NETWORK if isinstance(method, Network) else choice.method
    return Estimator(sensor, name, network, tuple(sorted(options.items())))


def reconstruct(
    x: "Bits | dask.array.Array",
    sensor: Sensor | None = None,
    window: int | None = None,
    step: int | None = None,
    *,
    method: str | Network | None = None,
    quality: str | None = None,
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
        method for the sensor.
    quality : {"two-layer", "small", "medium", "large"}, optional
        Size of a shipped network, in place of a method.
    width : int, optional
        W: the true width in jots. Default: that of the bits, or a multiple of 8.
    **options
        Options of the method, such as `weight`.

    Returns
    -------
    dask.array.Array of float32, shape (N, H / K̂, W / K̂) or (N, H / K̂, W / K̂, C)
        Intensities in [0, S].

    Raises
    ------
    MissingExtraError
        When dask is not installed.
    TypeError, ValueError
        When the data, their sensor, the method, and its options do not fit together.

    Notes
    -----
    The method gets the counts of each window. Images of more than 4 Mpixel are divided into tiles
    of at most 1024 x 1024 pixels, with the halo of the method, if the sensor has no maps and the
    method is "mle" or a network. The tiles do not depend on the chunks, so neither does the result.

    Examples
    --------
    >>> bits = Sensor(frames=64).expose(np.full((16, 16), 0.5), rng=0)
    >>> reconstruct(bits, window=16, method="mle").shape
    (4, 16, 16)
    """
    if sensor is None and isinstance(x, Bits):
        sensor = x.sensor  # type: ignore[assignment]
    if sensor is None:
        raise TypeError(
            "sensor: expected a jotlight.Sensor, because these bits carry none; pass the sensor "
            "that recorded them, such as Sensor(frames=16)"
        )
    require_sensor(sensor)
    window = int(x.shape[0]) if window is None else window
    estimator = choose_estimator(sensor.replace(frames=window), method, quality, options)
    counts = count(x, window, step, oversampling=sensor.oversampling, width=width)
    sensor.check_map_shapes(*(size * sensor.oversampling for size in counts.shape[1:3]))
    meta = np.empty((0,) * counts.ndim, np.float32)
    halo = estimator.halo
    is_small = counts.shape[1] * counts.shape[2] <= _MAX_PIXELS
    if halo is None or is_small or halo > _TILE // 2:
        return counts.map_blocks(estimator, dtype=np.float32, meta=meta)
    # Equal tiles, because a tile must not be smaller than the halo.
    sides = {axis: -(-counts.shape[axis] // -(-counts.shape[axis] // _TILE)) for axis in (1, 2)}
    tiles = counts.rechunk(sides)
    return tiles.map_overlap(
        estimator,
        depth={1: halo, 2: halo},
        boundary="none",
        allow_rechunk=False,
        dtype=np.float32,
        meta=meta,
    )
