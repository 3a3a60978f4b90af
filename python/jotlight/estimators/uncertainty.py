"""The uncertainty of each pixel, and the exact confidence interval of `jotlight.mle`."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn, Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.errors import hide_warnings
from jotlight.estimators.inverse_response import warn_about_smooth_kernel
from jotlight.estimators.light_inversion import (
    LightInverse,
    UniqueCounts,
    build_light_inverse,
    jot_maps,
)
from jotlight.estimators.mle import mle, require_bits
from jotlight.estimators.planning.figure import draw_map
from jotlight.layout import Layout, join
from jotlight.notebook import card, normalize
from jotlight.sensing.data.pixel_counts import GrayImages, PixelCounts
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.parameters.binomial import clopper_pearson
from jotlight.sensing.sensor import Sensor
from jotlight.squares import repeat_squares

if TYPE_CHECKING:
    from jotlight.figures import Figure


_FLOATS = "standard_error", "low", "high"
"""Names of the arrays that have units."""

_FLAGS = "unlit", "saturated", "dead", "unlikely"
"""Names of the arrays of flags."""


@dataclasses.dataclass(frozen=True, eq=False)
class Uncertainty:
    """The uncertainty of each pixel's intensity. All arrays have the shape of the estimate.

    `standard_error`, `low`, and `high` are float32 in the requested units. `unlit`, `saturated`,
    `dead`, and `unlikely` are bool.

    Attributes
    ----------
    standard_error : ndarray of float32
        The standard error of the estimate, in the requested units.

        It is inf for a dead pixel, and where the bits contain practically no information about the
        intensity.
    low : ndarray of float32
        The lower end of the confidence interval, in the same units.
    high : ndarray of float32
        The upper end of the confidence interval; S where the data do not bound it, or only beyond
        S.
    unlit : ndarray of bool
        Whether the interval includes 0, and dark counts alone explain the ones of the pixel.
    saturated : ndarray of bool
        Whether `high` says nothing about the intensity: all valid bits are 1, so that the data do
        not bound it from above, or the pixel is brighter than S. For maximum likelihood, this is
        where all intensities of the interval are S or more, before they are limited to S. For other
        methods, it is where the bits of the pixel, or of a block of 8 x 8 pixels, show it beyond
        doubt.
    dead : ndarray of bool
        Whether the pixel has no valid bit.
    unlikely : ndarray of bool
        Whether the bits contradict the estimate: held-out bits near the pixel are less probable
        under it than under the fractions of ones alone, or their number is not what it predicts.
        The scene is then unlike photographs. For blends and methods without a network, this is
        about the estimate of a network. It is False for maximum likelihood, and with fewer than 4
        trials.
    confidence_level : float
        The coverage of the intervals.
    """

    standard_error: npt.NDArray[np.float32]
    low: npt.NDArray[np.float32]
    high: npt.NDArray[np.float32]
    unlit: npt.NDArray[np.bool_]
    saturated: npt.NDArray[np.bool_]
    dead: npt.NDArray[np.bool_]
    unlikely: npt.NDArray[np.bool_]
    confidence_level: float

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> NoReturn:
        """Raise TypeError, because there are several maps."""
        raise TypeError(
            "expected an array, got Uncertainty; take one of its maps, such as "
            "uncertainty.standard_error, uncertainty.low, or uncertainty.high"
        )

    def flags(self) -> npt.NDArray[np.uint8]:
        """Return a sum for each pixel: 1 if it is unlit, 2 saturated, 4 dead, and 8 unlikely."""
        flags = self.unlit, self.saturated, self.dead, self.unlikely
        return np.asarray(sum(2**place * flag for place, flag in enumerate(flags)), np.uint8)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the standard error, the interval, and the flags."""
        floats = {name: getattr(self, name) for name in _FLOATS}
        return {**floats, "flags": self.flags()}

    @classmethod
    def arrange(cls, parts: Sequence[Self], layout: Layout) -> Self:
        """Return the uncertainty of a stack or of color channels from that of gray images."""
        arrays = {
            name: layout.arrange(join([getattr(part, name) for part in parts]))
            for name in (*_FLOATS, *_FLAGS)
        }
        return cls(confidence_level=parts[0].confidence_level, **arrays)

    def scaled(self, factor: npt.ArrayLike) -> Self:
        """Return the uncertainty in units that are `factor` per unit of intensity.

        There may be a factor for each color.
        """
        changed = {name: getattr(self, name) * np.asarray(factor, np.float32) for name in _FLOATS}
        return dataclasses.replace(self, **changed)

    def plot(self) -> Figure:
        """Return a figure of the standard error and of the width of the interval.

        The first image of a stack is shown, and the mean over the channels.
        """
        from jotlight.figures import Figure

        height, width = _first_image(self.standard_error).shape[:2]
        figure = Figure(10, min(10.0, 0.8 + 4.2 * height / width))
        shown = {
            "standard error": self.standard_error,
            f"width of the {self.confidence_level:.0%} interval": self.high - self.low,
        }
        for axes, (title, all_values) in zip(figure.subplots(1, 2), shown.items(), strict=True):
            values = _first_image(all_values)
            draw_map(axes, values.mean(axis=2) if values.ndim == 3 else values, title)
        return figure

    def _facts(self) -> dict[str, str]:
        facts = {"size": " x ".join(map(str, self.standard_error.shape))}
        finite = self.standard_error[np.isfinite(self.standard_error)]
        if finite.size:
            facts["standard error"] = f"{np.median(finite):.3g} in the median"
        facts["interval"] = f"{self.confidence_level:.6g}"
        for name in _FLAGS:
            facts[name] = f"{getattr(self, name).mean():.2%}"
        return facts

    def _repr_html_(self) -> str:
        facts = {**self._facts(), "image": "the standard error"}
        return card("Uncertainty", facts, normalize(_first_image(self.standard_error)))

    def __repr__(self) -> str:
        facts = ", ".join(f"{name} {value}" for name, value in self._facts().items())
        return f"<Uncertainty: {facts}>"


def _first_image(values: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Return the first image of a stack, (H, W) or (H, W, C)."""
    while values.ndim > 3 or (values.ndim == 3 and values.shape[2] > 4):
        values = values[0]
    return values


def exact_uncertainty(
    images: GrayImages, sensor: Sensor, confidence_level: float, threads: int | None
) -> Uncertainty:
    """Return the standard error and the exact interval of `jotlight.mle`, in units of intensity.

    Parameters
    ----------
    images : GrayImages
        The data.
    sensor : Sensor
        The sensor that recorded them, with the box kernel.
    confidence_level : float
        The coverage of the intervals, in [0.5, 1).
    threads : int, optional
        The number of threads. Default: the number of cores.

    Notes
    -----
    The standard error is ``(K/α) I^(-1/2)``, where I is the Fisher information of the pixel's bits
    about the light s, at the estimate. For a count of 0 or n, I is evaluated half a count away, so
    that the error is neither 0 nor infinite. With few bits, or for counts near 0 or n, the interval
    is more informative.

    The interval is that of Clopper and Pearson for the probability p that a bit is 1. The monotone
    response P(q, η s + d) maps it to intensities, and it is clipped to [0, S]. Its coverage is at
    least `confidence_level` for any number of bits and any true intensity in [0, S]. It is well
    above that near 0, near saturation, and with few bits. Where the whole interval is above S, both
    ends are S, and the pixel is marked as saturated. Where the jots of one pixel differ, p
    is their mean. The sum of unequal bits varies less than a binomial count (Hoeffding 1956), so
    the coverage holds and the interval is somewhat wider than necessary. The estimate then depends
    on which jots reported 1, and the interval is extended to include it. This case requires bits,
    as in `jotlight.mle`.
    """
    warn_about_smooth_kernel(sensor)
    each = [_uncertainty(part, sensor, confidence_level, threads) for part in images.parts(sensor)]
    return Uncertainty.arrange(each, images.layout)


def _uncertainty(
    images: GrayImages, sensor: Sensor, confidence_level: float, threads: int | None
) -> Uncertainty:
    """Return the uncertainty of gray images, whose arrays have the shape (N, H, W)."""
    pixels = images.count(sensor, threads)
    if pixels.varies_within_pixels:
        for image in images.data:
            require_bits(image)
    trials = np.broadcast_to(np.asarray(pixels.trials, np.float64), pixels.counts.shape)
    dead = trials == 0
    saturated = (pixels.counts == trials) & ~dead
    unique = UniqueCounts(pixels)
    invert = build_light_inverse(pixels, unique)
    tail = (1 - confidence_level) / 2
    interval = clopper_pearson(
        unique.ones, unique.bits, tail, jots_differ=pixels.varies_within_pixels
    )
    scale, max_intensity = 1 / sensor.light_per_intensity, sensor.max_intensity
    low, high = (np.clip(invert(p, rest) * scale, 0, max_intensity) for p, rest in interval)
    estimate = _silent_mle(images, sensor, threads) if pixels.varies_within_pixels else None
    if estimate is not None:
        low, high = np.minimum(low, estimate), np.maximum(high, estimate)
    low[dead], high[dead | saturated] = 0, max_intensity
    light = _regular_light(pixels, unique, invert, estimate)
    return Uncertainty(
        standard_error=_standard_error(pixels, trials, light, threads),
        low=low.astype(np.float32),
        high=high.astype(np.float32),
        unlit=(low <= 0) & ~dead,
        saturated=saturated | is_above(low, max_intensity),
        dead=dead,
        unlikely=np.zeros_like(dead),
        confidence_level=confidence_level,
    )


def is_above(low: Array, max_intensity: float) -> npt.NDArray[np.bool_]:
    """Return where a whole interval is above S, so that its limited lower end is S.

    Examples
    --------
    >>> is_above(np.array([0.5, 0.999, 1 - 1e-9]), 1.0)  # the last one is S with rounding errors
    array([False, False,  True])
    """
    return np.asarray(low.astype(np.float32) >= np.float32(max_intensity))


def _regular_light(
    pixels: PixelCounts, unique: UniqueCounts, invert: LightInverse, estimate: Image | None
) -> Array:
    """Return the estimated light, where counts of 0 and n are moved inward by half a count.

    The estimate is given where the jots of a pixel differ.
    """
    light_per_intensity = pixels.sensor.light_per_intensity
    bits = np.maximum(unique.bits, 1)
    inside = np.clip(unique.ones, 0.5, bits - 0.5) / bits
    light = invert(inside, 1 - inside)
    if estimate is not None:
        extreme = (pixels.counts == 0) | (pixels.counts == unique.expand(unique.bits))
        light = np.where(extreme, light, estimate * light_per_intensity)
    return np.clip(light, 0, pixels.sensor.max_intensity * light_per_intensity)


def _standard_error(pixels: PixelCounts, trials: Array, light: Array, threads: int | None) -> Image:
    """Return (K/α) I^(-1/2) at the light (N, H, W). I is summed over the jots if they differ."""
    sensor = pixels.sensor
    side = sensor.oversampling if pixels.varies_within_pixels else 1
    images, height, width = light.shape
    cells = (images, height * side, width * side)
    if pixels.varies_within_pixels:
        efficiency, dark_counts, alive = jot_maps(sensor)
        number = np.broadcast_to(np.where(alive, float(sensor.frames), 0.0), cells)
        efficiency, dark_counts = (
            np.broadcast_to(value, cells) if isinstance(value, np.ndarray) else value
            for value in (efficiency, dark_counts)
        )
    else:
        efficiency, dark_counts, number = pixels.efficiency, pixels.dark_counts, trials
    information = Likelihood(
        np.zeros(cells, np.int32),
        np.ascontiguousarray(number),
        threshold=sensor.threshold,
        efficiency=efficiency,
        dark_counts=dark_counts,
        threads=threads,
    ).information(repeat_squares(light, side))
    blocks = information.reshape(images, height, side, width, side)
    pixel_information = blocks.sum(axis=(2, 4))
    with np.errstate(divide="ignore", over="ignore"):
        error = 1 / (np.sqrt(pixel_information) * sensor.light_per_intensity)
        return np.asarray(error.astype(np.float32))


def _silent_mle(images: GrayImages, sensor: Sensor, threads: int | None) -> Image:
    """Return the estimate without a warning about dead pixels, because they get a flag."""
    with hide_warnings():
        return mle(images, sensor, threads=threads)
