"""Intervals of red, green, and blue that are estimated from the image of a mosaic.

As for gray images, the errors of a network are known from photographs, and held-out bits correct
them. A pixel's bits test the light behind its own filter.
"""

import dataclasses
from collections.abc import Callable
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.errors import hide_warnings
from jotlight.estimators.readings.typical_trials import typical_trials
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.color.color_images import count_image
from jotlight.evaluation.contradictions.bright_pixels import bright_behind_mosaic
from jotlight.evaluation.intervals.error_scale import (
    COLOR_FILE,
    ErrorModel,
    Half,
    HalfErrors,
    correction,
    divide_bits,
    error_model,
)
from jotlight.evaluation.intervals.interval_pixels import Pixels
from jotlight.evaluation.intervals.intervals import MIN_TRIALS
from jotlight.evaluation.intervals.known_errors import KnownErrors
from jotlight.evaluation.intervals.known_estimate import read_estimate
from jotlight.evaluation.intervals.stabilized import intensity_of, stabilize
from jotlight.evaluation.many_trials import MAX_NETWORK_TRIALS
from jotlight.kept import kept_property
from jotlight.layout import Layout
from jotlight.networks.color.color_inference import estimate_mosaic
from jotlight.networks.color.mosaic_planes import find_unseen
from jotlight.networks.pretrained import (
    COLOR_START,
    MOSAIC_FILE,
    pretrained_color,
    pretrained_conditional,
)
from jotlight.sensing.data.pixel_counts import (
    Data,
    PixelCounts,
    count_pixels,
    gray_images,
    prepare_data,
)
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.response import detection_density
from jotlight.sensing.sensor import Sensor

_MIN_SHARE = 0.03
"""Smallest fraction of the pixels that count for a color."""

_NEIGHBORHOOD = 1.0
"""Standard deviation of the filter of the trials of a color, in mean distances of its pixels."""


@dataclasses.dataclass(frozen=True)
class MosaicPixels:
    """The pixels of the image of a mosaic, (H, W)."""

    counted: PixelCounts
    """Their counts. The sensor has no mosaic."""
    mosaic: Mosaic
    """The filters, without a white balance."""
    threads: int | None = None

    @classmethod
    def of(cls, counted: PixelCounts, mosaic: Mosaic, threads: int | None = None) -> Self:
        """Return the pixels of an image; estimates of their colors have no white balance."""
        return cls(counted, mosaic.without_white_balance(), threads)

    @property
    def sensor(self) -> Sensor:
        """The sensor, without the mosaic."""
        return self.counted.sensor

    @kept_property
    def trials(self) -> Array:
        """The number of trials of each pixel."""
        return np.broadcast_to(np.asarray(self.counted.trials, float), self.counted.counts.shape)

    @kept_property
    def behind_filters(self) -> Pixels:
        """The pixels as those of a gray image, whose light has passed the filters."""
        jot = self.counted.efficiency, self.counted.dark_counts
        return Pixels(self.sensor, self.counted.counts, self.trials, *jot)

    @kept_property
    def shares(self) -> Array:
        """The part of the light of each color that passes each pixel's filter, (3, H, W)."""
        places = self.mosaic.full(*self.counted.counts.shape)
        return np.moveaxis(self.mosaic.transmission[places], -1, 0)

    @kept_property
    def densities(self) -> Array:
        """The fraction of the pixels whose bits determine each color, (3,).

        For a constant image, least squares estimates each color as precisely as this fraction of
        pixels behind a filter of that color alone would. RGGB: 1/4, 1/2, 1/4.
        """
        shares = self.shares.reshape(3, -1)
        normal = shares @ shares.T / shares.shape[1]
        return np.maximum(1 / np.maximum(np.diag(np.linalg.pinv(normal)), 1e-9), _MIN_SHARE)

    def colors_of(self, color: int) -> Pixels:
        """Return the pixels of a gray image with as many trials as those of a color."""
        jot = reference_jot(self.sensor)
        trials = self.densities[color] * self._trials_near[color]
        return Pixels(self.sensor, self.counted.counts, trials, *jot)

    @kept_property
    def _trials_near(self) -> Array:
        """The trials of the pixels around each pixel that see each color, (3, H, W).

        Equivalent counts of one filter may have many more trials than those of another.
        """
        from scipy.ndimage import gaussian_filter

        some = np.where(self.trials > 0, self.trials, 1.0)
        if np.ptp(some) == 0:
            return np.broadcast_to(some, self.shares.shape)
        near = []
        for share, density in zip(self.shares, self.densities, strict=True):
            sigma = _NEIGHBORHOOD / np.sqrt(density)
            seen, weight = (gaussian_filter(part, sigma) for part in (share * some, share))
            near.append(np.where(weight > 1e-9, seen / np.maximum(weight, 1e-9), some))
        return np.stack(near)

    def estimate(self, counted: PixelCounts | None = None) -> Image:
        """Return the colors by the color network, (H, W, 3), of these counts or of others."""
        networks = pretrained_color(MOSAIC_FILE), pretrained_conditional(self.sensor, COLOR_START)
        with hide_warnings():
            colors = estimate_mosaic(*networks, counted or self.counted, self.mosaic, self.threads)
        return np.clip(colors, 0, self.sensor.max_intensity)

    def halves(self) -> list[tuple[Image, Half, Half]]:
        """Return the colors from each half of the bits, that half, and the other.

        There are none if halves show no errors: with few trials, or in a tiny image, where a half
        may have no bit of a color.
        """
        if np.median(self.trials) < MIN_TRIALS:
            return []
        pair = divide_bits(self.counted.counts, self.trials)
        counted = [
            count_pixels(
                self.behind_filters.merged(half.ones, half.trials), self.sensor, self.threads
            )
            for half in pair
        ]
        if any(find_unseen(each, self.mosaic) for each in counted):
            return []
        colors = map(self.estimate, counted)
        return list(zip(colors, pair, pair[::-1], strict=True))

    def scale(
        self, model: ErrorModel, colors: Image, halves: list[tuple[Image, Half, Half]]
    ) -> tuple[list[Array], list[HalfErrors]]:
        """Return the scales of the errors of the network's colors, and the errors from halves."""
        scales = self._of_model(model, colors, 1.0)
        errors, expected = [], []
        for estimate, trained, held_out in halves:
            measured = HalfErrors.measure(self._seen(estimate), trained, held_out)
            known = measured.known & self._shows_one_color()
            z = self._brightness(estimate)
            errors.append(dataclasses.replace(measured, z=z, known=known))
            expected.append(self._expected(model, estimate))
        if errors:
            factor = correction(errors, expected, self._brightness(colors))
            scales = [factor * scale for scale in scales]
        return scales, errors

    def _of_model(self, model: ErrorModel, colors: Image, fraction: float) -> list[Array]:
        """Return the scales from photographs with a fraction of the trials."""
        scales = []
        for color, share in enumerate(self.shares):
            pixels = self.colors_of(color)
            z = pixels.stabilize(colors[..., color])
            scales.append(model.scale(z, np.maximum(fraction * pixels.trials, 0.5), share))
        return scales

    def _expected(self, model: ErrorModel, colors: Image) -> Array:
        """Return the squared errors of p behind each filter that the model expects of a half."""
        error = np.zeros(self.trials.shape)
        for color, scale in enumerate(self._of_model(model, colors, 0.5)):
            pixels = self.colors_of(color)
            z, trials = pixels.stabilize(colors[..., color]), np.maximum(pixels.trials / 2, 0.5)
            deviation = scale * model.deviations(z, trials)
            jot = pixels.efficiency, pixels.dark_counts
            low, high = (intensity_of(z + sign * deviation, self.sensor, *jot) for sign in (-1, 1))
            error += (self.shares[color] * (high - low) / 2) ** 2
        rate = self._rate(colors)
        slope = detection_density(self.sensor.threshold, rate) * self.counted.efficiency
        return np.asarray((slope * self.sensor.light_per_intensity) ** 2 * error)

    def _shows_one_color(self) -> npt.NDArray[np.bool_]:
        """Return the pixels whose errors are those of one color: all if there are hardly any.

        A clear pixel shows the sum of the colors, whose error is smaller than those of the colors.
        """
        one = self.shares.max(axis=0) > self.shares.sum(axis=0) / 2
        return one if one.mean() >= _MIN_SHARE else np.ones_like(one)

    def _rate(self, colors: Image) -> Array:
        """Return the mean number of photons of a jot behind each pixel's filter."""
        light = np.einsum("chw,hwc->hw", self.shares, colors.astype(np.float64))
        return np.asarray(
            self.counted.efficiency * self.sensor.light_per_intensity * light
            + self.counted.dark_counts
        )

    def _seen(self, colors: Image) -> Array:
        """Return z of the light behind each pixel's filter."""
        light = np.einsum("chw,hwc->hw", self.shares, colors.astype(np.float64))
        return stabilize(light, self.sensor, self.counted.efficiency, self.counted.dark_counts)

    def _brightness(self, colors: Image) -> Array:
        """Return z of the mean of the colors, which has no pattern of filters."""
        mean = colors.astype(np.float64).mean(axis=-1)
        return stabilize(mean, self.sensor, *reference_jot(self.sensor))


def find_color_intervals(
    pixels: MosaicPixels, colors: Image, *, is_own: bool, confidence_level: float
) -> list[Uncertainty]:
    """Return the uncertainty (1, H, W) of each color of an estimate, in units of intensity.

    Parameters
    ----------
    pixels : MosaicPixels
        The data.
    colors : ndarray of float32, shape (H, W, 3)
        The estimate of any method, without white balance.
    is_own : bool
        Whether the estimate is that of the color network.
    confidence_level : float
        Coverage of the intervals.
    """
    model = error_model(COLOR_FILE)
    known = colors if is_own else pixels.estimate()
    scales, errors = pixels.scale(model, known, pixels.halves())
    dead = pixels.trials == 0
    saturated = (pixels.counted.counts == pixels.trials) & ~dead
    results = []
    for color, scale in enumerate(scales):
        gray = pixels.colors_of(color)
        own = np.ascontiguousarray(colors[..., color])
        of_network = KnownErrors(known[..., color], scale, errors, model)
        if not is_own:
            difference = gray.stabilize(own) - gray.stabilize(known[..., color])
            of_network = of_network.widened(difference)
        unbounded = pixels.behind_filters.unbounded
        found = gray.uncertainty(own, of_network, confidence_level, unbounded)
        is_saturated = saturated & (pixels.shares[color] > 0)
        results.append(dataclasses.replace(found, saturated=is_saturated[None], dead=dead[None]))
    return results


def check_color_errors_known(trials: float | np.floating) -> None:
    """Raise ValueError if the errors of colors are not known for a number of trials per pixel.

    Examples
    --------
    >>> check_color_errors_known(1000)
    """
    if trials > MAX_NETWORK_TRIALS:
        raise ValueError(
            f"data: expected up to {MAX_NETWORK_TRIALS:,} trials per pixel, because the errors of "
            f"colors are not known for more, got {trials:,.0f}; take fewer frames"
        )


def mosaic_uncertainty(
    data: Data,
    sensor: Sensor,
    estimate: Callable[[], npt.ArrayLike],
    *,
    is_own: bool,
    confidence_level: float,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    threads: int | None = None,
) -> Uncertainty:
    """Return the uncertainty (..., H, W, 3) of the colors of the image of a mosaic, or of a stack.

    Parameters
    ----------
    data, sensor, trials, channel_axis, threads
        As of :func:`jotlight.uncertainty`. The sensor has a mosaic.
    estimate : callable
        A function that returns the estimate, (..., H, W, 3). It is called after all checks.
    is_own : bool
        Whether the estimate is that of the color network.
    confidence_level : float
        Coverage of the intervals.

    Raises
    ------
    TypeError, ValueError
        When the data, their sensor, and the estimate do not fit together, or when there are more
        than 1,000 trials per pixel.
    """
    mosaic: Mosaic = sensor.mosaic
    prepared, gray = prepare_data(
        data, sensor, trials, channel_axis, may_differ=True, takes_mosaics=True
    )
    images = gray_images(prepared)
    pixels = []
    for one in images.data:
        counted = count_image(one, gray, threads, mosaic)
        pixels.append(MosaicPixels.of(counted, mosaic, threads))
        is_plain = gray.has_plain_bits
        check_color_errors_known(np.median(pixels[-1].trials) if is_plain else typical_trials(gray))
    expected = *images.layout.shape, *pixels[0].trials.shape, 3
    largest = sensor.max_intensity * np.maximum(mosaic.white_balance, 1e-6)
    colors = read_estimate(estimate(), expected, largest)
    plain = colors / np.maximum(mosaic.white_balance, 1e-6).astype(np.float32)
    results: list[Uncertainty] = []
    for each, own_colors in zip(pixels, plain.reshape(-1, *expected[-3:]), strict=True):
        results += find_color_intervals(
            each, own_colors, is_own=is_own, confidence_level=confidence_level
        )
    found = Uncertainty.arrange(results, Layout((*images.layout.shape, 3), -1))
    bright = bright_behind_mosaic([each.counted for each in pixels], mosaic)
    # A pixel says nothing about the colors that its filter stops.
    is_seen = np.moveaxis(pixels[0].shares > 0, 0, -1)
    saturated = found.saturated | (images.layout.arrange(bright)[..., None] & is_seen)
    return dataclasses.replace(found, saturated=saturated).scaled(mosaic.white_balance)
