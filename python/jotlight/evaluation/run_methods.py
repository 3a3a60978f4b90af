"""Many methods on the bits of one image: their estimates, quality, and computing times."""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight.metrics as metrics
from jotlight.errors import hide_warnings
from jotlight.estimators.iterative.convergence import IterationCallback, follow_slowest
from jotlight.evaluation.color.color_data import check_taken
from jotlight.evaluation.methods import COLOR_NETWORK, METHODS, Method, find_method
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.channels import last_channel_axis
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.sensor import Sensor

_SMALL_SIDE = 16
"""Side of the flat image on which methods first run, in pixels."""


@dataclasses.dataclass(frozen=True, eq=False)
class MethodResult:
    """The estimate of one method, its quality, and its computing time."""

    method: str
    estimate: npt.NDArray[np.float32] = dataclasses.field(repr=False)
    psnr: float
    """PSNR in dB, for a peak of 1."""
    ssim: float | None
    """SSIM, or None for images smaller than its window."""
    seconds: float


def select_methods(sensor: Sensor, names: Sequence[str] | None = None) -> list[str]:
    """Return the names of the methods to compare, all of which serve the sensor.

    Parameters
    ----------
    sensor : Sensor
        Sensor of the data.
    names : sequence of str, optional
        Names to check and return. Default: all methods for gray images that are installed, serve
        the sensor, and differ from every faster method.

    Raises
    ------
    ValueError
        For an unknown name, or a method that does not serve the sensor.
    """
    if names is None:
        return [
            name
            for name, method in METHODS.items()
            if method.available
            and method.unsupported_reason(sensor) is None
            and method.is_distinct(sensor)
        ]
    for name in names:
        if name == COLOR_NETWORK:
            check_taken(sensor, has_form=True)
        elif (reason := find_method(name).unsupported_reason(sensor)) is not None:
            raise ValueError(f"{name}: {reason}")
    return list(names)


def compare_methods(
    image: npt.NDArray[np.floating],
    bits: Bits | Readings,
    sensor: Sensor,
    names: Sequence[str],
    *,
    threads: int | None = None,
    begin: Callable[[str], object] = lambda title: None,
    methods: Mapping[str, Method] = METHODS,
) -> list[MethodResult]:
    """Return the estimate, quality, and computing time of each method on the same bits.

    Each method first runs on a small image, so that its time does not include loading libraries.

    Parameters
    ----------
    image : ndarray, shape (H, W) or (H, W, C)
        Ground truth, in units of intensity.
    bits : Bits or Readings
        Bits of the image, or readings of several bits.
    sensor : Sensor
        Sensor of the bits.
    names : sequence of str
        Keys of `methods`.
    threads : int, optional
        The number of threads. Default: the number of cores.
    begin : callable, optional
        Called with the title of each method before it runs. If `begin` returns a function, an
        iterative method calls this function with its progress in [0, 1].
    methods : mapping of str to Method, optional
        Methods by name.
    """
    results = []
    for name in names:
        method = methods[name]
        update = begin(method.title)
        if method.warms_up:
            _warm_up(method, sensor, image.shape, threads)
        options: dict[str, Any] = {}
        if method.iterative and callable(update):
            options["callback"] = _report_progress(update)
        start = time.perf_counter()
        estimate = method.run(bits, sensor, threads=threads, **options)
        seconds = time.perf_counter() - start
        ssim = metrics.ssim_or_none(estimate, image, last_channel_axis(image))
        psnr = metrics.psnr(estimate, image, data_range=1.0)
        results.append(MethodResult(name, estimate, psnr, ssim, seconds))
    return results


def _report_progress(update: Callable[[float], object]) -> IterationCallback:
    return follow_slowest(lambda step: update(step.progress))


def _warm_up(method: Method, sensor: Sensor, shape: tuple[int, ...], threads: int | None) -> None:
    """Run a method on a flat image of 16 x 16 pixels, if the image is that large."""
    if min(shape[:2]) < _SMALL_SIDE:
        return
    small = sensor.without_maps()
    if small.mosaic is not None:
        small = small.replace(mosaic=small.mosaic.crop(range(_SMALL_SIDE), range(_SMALL_SIDE)))
    flat = np.full((_SMALL_SIDE, _SMALL_SIDE, *shape[2:]), small.max_intensity / 2)
    bits = small.expose(flat, rng=0, channel_axis=last_channel_axis(flat), threads=threads)
    with hide_warnings():
        method.run(bits, small, threads=threads)
