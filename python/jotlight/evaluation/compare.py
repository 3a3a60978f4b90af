"""Methods side by side on one photograph."""

import dataclasses
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight import metrics
from jotlight.errors import JotlightWarning
from jotlight.evaluation.methods import METHODS, Method
from jotlight.sensing.bits import Bits
from jotlight.sensing.sensor import Sensor


@dataclasses.dataclass(frozen=True)
class Result:
    """What a method made of the bits."""

    method: str
    picture: npt.NDArray[np.float32]
    psnr: float
    """In dB, for a peak of 1."""
    ssim: float | None
    """None for pictures smaller than its window."""
    seconds: float


def chosen(sensor: Sensor, names: Sequence[str] | None = None) -> list[str]:
    """Check the names of methods; without names, take all that are installed and serve the sensor.

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
        if name not in METHODS:
            raise ValueError(f"methods: expected some of {', '.join(METHODS)}, got {name!r}")
        if (reason := METHODS[name].unsupported_reason(sensor)) is not None:
            raise ValueError(f"{name}: {reason}")
    return list(names)


def compare_methods(
    image: npt.NDArray[np.floating],
    bits: Bits,
    sensor: Sensor,
    names: Sequence[str],
    *,
    threads: int | None = None,
    begin: Callable[[str], object] = lambda title: None,
    methods: Mapping[str, Method] = METHODS,
) -> list[Result]:
    """Run methods on the same bits and measure each against the image.

    `begin` is called with each method's title before it runs; what it gives, if that can be called,
    is told the share that a method which iterates has done. Each is run on a small corner first, so
    that loading its library is not counted in its time.
    """
    results = []
    corner = Bits(
        np.ascontiguousarray(bits.packed[:, : 16 * sensor.oversampling, : 2 * sensor.oversampling]),
    )
    for name in names:
        method = methods[name]
        update = begin(method.title)
        if min(image.shape[:2]) >= 16:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", JotlightWarning)
                method.run(corner, sensor.without_maps(), threads=threads)
        options: dict[str, Any] = {}
        if method.iterative and callable(update):
            options["callback"] = lambda step, update=update: update(step.progress)
        start = time.perf_counter()
        picture = method.run(bits, sensor, threads=threads, **options)
        seconds = time.perf_counter() - start
        results.append(
            Result(
                name,
                picture,
                metrics.psnr(picture, image),
                metrics.ssim(picture, image) if min(image.shape[:2]) >= 11 else None,
                seconds,
            )
        )
    return results
