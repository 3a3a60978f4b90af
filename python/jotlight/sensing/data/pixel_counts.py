"""The number of ones and the number of valid bits of each pixel, from bits or counts."""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_counts, check_threads, refuse_masked
from jotlight.layout import Layout, join
from jotlight.paths import refuse_path
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits, refuse_frames
from jotlight.sensing.bits.counting import count_ones
from jotlight.sensing.bits.readings import Readings, image_of_readings
from jotlight.sensing.bits.values import check_any_valid, checked_trials
from jotlight.sensing.data.contradictions import warn_about_contradictions
from jotlight.sensing.data.data_lists import carried_sensor, list_of_data
from jotlight.sensing.data.periodic_rates import warn_about_periods
from jotlight.sensing.data.scaled_counts import check_range, check_whole, warn_about_unpacked_frames
from jotlight.sensing.data.stated_trials import merge_counts, with_trials
from jotlight.sensing.merged import Merged, check_sensor_of_merged, refuse_finer_grid
from jotlight.sensing.parameters.maps import (
    constant_or_map,
    mean_dark_counts,
    pixel_means,
    stack_maps,
)
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor, require_sensor

GrayData = Bits | Readings | Merged | npt.NDArray[np.int32]
"""The data of one gray image: bits or readings (T, H·K̂, W·K̂), or counts (H, W)."""

MAX_PIXELS = 1 << 18
"""Maximum number of pixels of the images that a method processes at once, if they are several."""


@dataclasses.dataclass(frozen=True, eq=False)
class PixelCounts:
    """The counts of the pixels of gray images, and the sensor parameters of each pixel.

    The counts are a sufficient statistic if the bits of each pixel are exchangeable, which requires
    the box kernel and equal jots in each pixel.
    """

    sensor: Sensor
    counts: npt.NDArray[np.int32]
    """L: the number of ones of each pixel, (H, W) or (N, H, W)."""
    trials: float | npt.NDArray[np.float64]
    """The number of valid bits of each pixel: K, or a map of the same shape where they differ."""
    efficiency: float | npt.NDArray[np.float64]
    """η of each pixel: a number or a map, with the mean over its jots where they differ."""
    dark_counts: float | npt.NDArray[np.float64]
    """d of each pixel: a number or a map. Where its jots differ, it is -log mean exp(-d) for q = 1,
    which keeps the mean count, and otherwise their mean."""
    varies_within_pixels: bool
    """Whether any pixel has jots that differ in efficiency or dark counts."""

    @property
    def uniform(self) -> bool:
        """Whether all pixels have the same trials, efficiency, and dark counts."""
        parameters = self.trials, self.efficiency, self.dark_counts
        return not self.varies_within_pixels and not any(
            isinstance(value, np.ndarray) for value in parameters
        )

    @property
    def dead_pixels(self) -> npt.NDArray[np.bool_] | None:
        """The pixels without a valid bit, if there are any."""
        dead = np.asarray(self.trials == 0)
        return np.broadcast_to(dead, self.counts.shape) if dead.any() else None

    def select(self, images: Sequence[int]) -> "PixelCounts":
        """Return the counts of some of N images."""
        maps: dict[str, Any] = {
            name: value[images]
            for name in ("counts", *_PARAMETERS)
            if isinstance(value := getattr(self, name), np.ndarray)
        }
        return dataclasses.replace(self, **maps)


_PARAMETERS = "trials", "efficiency", "dark_counts"
"""Names of the parameters of pixels, which are numbers or maps."""


@dataclasses.dataclass(frozen=True)
class GrayImages:
    """The data of the gray images of a stack, and of the channels of color images.

    Methods estimate each of them by itself.
    """

    data: Sequence[Bits | Readings | Merged] | npt.NDArray[np.int32]
    """The data of each gray image; counts are one array (N, H, W)."""
    layout: Layout
    """How the estimates of the gray images form one array."""

    def __len__(self) -> int:
        return len(self.data)

    def size(self, sensor: Sensor) -> tuple[int, int]:
        """Return H and W of the first image in pixels."""
        first = self.data[0]
        side = sensor.oversampling if isinstance(first, Bits | Readings) else 1
        height, width = first.shape[-2:]
        return height // side, width // side

    def parts(
        self, sensor: Sensor, max_pixels: int = MAX_PIXELS, *, together: int = 1
    ) -> Iterator["GrayImages"]:
        """Yield parts of a stack, of at most `max_pixels` pixels, but of one image or more.

        The numbers of images are multiples of `together`.
        """
        number = max(1, max_pixels // max(1, together * math.prod(self.size(sensor)))) * together
        for start in range(0, len(self), number):
            part = self.data[start : start + number]
            yield GrayImages(part, Layout((len(part),)))

    def select(self, places: Sequence[int]) -> "GrayImages":
        """Return some of the images."""
        data: Any = self.data
        data = data[places] if isinstance(data, np.ndarray) else [data[i] for i in places]
        return GrayImages(data, Layout((len(places),)))

    def count(self, sensor: Sensor, threads: int | None) -> PixelCounts:
        """Return the pixel counts of all gray images together, (N, H, W).

        Raises
        ------
        TypeError, ValueError
            When data and sensor do not fit together, or the images differ in size.
        """
        if isinstance(self.data, np.ndarray):
            return count_pixels(self.data, sensor, threads)
        if all(isinstance(one, Bits) for one in self.data):
            bits = cast(Sequence[Bits], self.data)
            for one in bits:
                check_fits(one.shape, sensor)
            _check_sizes(one.shape[-2:] for one in bits)
            ones = count_ones(bits, sensor.oversampling, sensor.mask, threads)
            return describe_pixels(ones, sensor)
        each = [count_pixels(one, sensor, threads) for one in self.data]
        _check_sizes(one.counts.shape for one in each)
        return PixelCounts(
            sensor,
            join([one.counts[None] for one in each]),
            **{
                name: stack_maps([getattr(one, name) for one in each], each[0].counts.shape)
                for name in _PARAMETERS
            },
            varies_within_pixels=any(one.varies_within_pixels for one in each),
        )


def _check_sizes(shapes: Iterable[tuple[int, ...]]) -> None:
    if len(sizes := set(shapes)) > 1:
        raise ValueError(f"data: expected images of the same size, got {sorted(sizes)}")


PreparedData = Bits | Readings | Merged | npt.NDArray[np.int32] | GrayImages
"""Bits, readings, merged counts, or counts (H, W) of one image, or several gray images."""

Data = PreparedData | Sequence[Bits] | Sequence[Readings] | Sequence[Merged] | npt.ArrayLike
"""Bits, readings of several bits, merged counts, or a list of them; or counts (..., H, W)."""


def prepare_data(
    data: Data,
    sensor: Sensor | None,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    *,
    may_differ: bool = False,
    takes_mosaics: bool = False,
) -> tuple[PreparedData, Sensor]:
    """Return the data of a method with their sensor: the given one, or the one that they carry.

    Unless the readings `may_differ`, the sensor must have one gain and threshold. It must be gray,
    unless the caller `takes_mosaics`: the returned sensor is without its mosaic.

    Stacks and color counts become gray images. Counts with `trials` become merged counts. Pixels
    that the mask marks have no trials. Bits and counts of single jots are tested for periods.

    Raises
    ------
    TypeError, ValueError
        When there is no sensor, all its jots are dead, it contradicts merged counts, or bits or
        merged counts come with `trials` or `channel_axis`, or these do not fit the counts.

    Warns
    -----
    JotlightWarning
        When the sensor contradicts that of the data, and when the rates of the jots repeat, as
        under a color filter mosaic (PeriodicRatesWarning).

    Examples
    --------
    >>> data, _ = prepare_data(np.array([[3, 1]]), jl.Sensor(frames=4), trials=[[4, 2.5]])
    >>> data.trials.tolist()
    [[4.0, 2.5]]
    """
    refuse_path(data)
    contradictions = warn_about_contradictions(data, sensor)
    sensor = carried_sensor(data) if sensor is None else sensor
    if sensor is None:
        refuse_frames(data)
        are_bits = isinstance(data, Bits) or bool(list_of_data(data))
        if not are_bits:
            as_counts(cast(npt.ArrayLike, data))  # an error for anything else
        raise TypeError(
            f"sensor: expected a jotlight.Sensor, because {'these bits' if are_bits else 'counts'} "
            "carry none; pass the sensor that recorded them, such as Sensor(frames=16) for 16 "
            "trials per pixel"
        )
    if has_mosaic := takes_mosaics and sensor.mosaic is not None:
        sensor = without_mosaic(sensor)
    require_sensor(sensor, may_differ=may_differ)
    check_any_valid(True if sensor.mask is None else ~sensor.mask)
    # The rates follow a map of thresholds or a mosaic, also one that the caller removed.
    may_repeat = has_mosaic or "mosaic" in contradictions or np.ndim(sensor.threshold) == 2
    several = list_of_data(data)
    if isinstance(data, Bits | Readings | Merged | GrayImages) or several:
        check_sensor_of_merged(several or [data], sensor)
        warn_about_periods([] if may_repeat else several or [data])
        for name, value in (("trials", trials), ("channel_axis", channel_axis)):
            if value is not None:
                raise TypeError(
                    f"{name}: expected none, because {type(data).__name__} state their own; leave "
                    f"out {name}, or pass counts"
                )
        return (_gray_images_of_list(several) if several else cast(PreparedData, data)), sensor
    check_whole(data, sensor.trials)
    if sensor.bit_depth > 1:
        return image_of_readings(data, sensor, trials, channel_axis), sensor
    counts = as_counts(cast(npt.ArrayLike, data))
    if trials is not None and not sensor.has_plain_bits:
        sensor, trials = with_trials(sensor, checked_trials(trials, counts)), None
    layout = Layout.of("counts", counts, channel_axis)
    images: Any = np.ascontiguousarray(layout.split(counts))
    # With an oversampling, the jots are not counted.
    if sensor.oversampling == 1 and channel_axis is None and not may_repeat:
        warn_about_periods([images])
    warn_about_unpacked_frames(images, sensor)
    if trials is not None:
        _check_jots(images, sensor)
        refuse_masked("trials", trials)
        if np.ndim(trials) == 2 and np.shape(trials) == images.shape[1:]:
            trials = layout.arrange(np.broadcast_to(trials, images.shape))
        checked = checked_trials(trials, counts)
        own = layout.split(checked) if isinstance(checked, np.ndarray) else [checked] * len(images)
        images = [merge_counts(*each, sensor) for each in zip(images, own, strict=True)]
    return (images[0] if layout.is_single else GrayImages(images, layout)), sensor


def _gray_images_of_list(data: Sequence[Bits | Readings | Merged]) -> GrayImages:
    """Return the gray images of a list of bits or of merged counts."""
    each: list[GrayImages] = [gray_images(one) for one in data]
    layouts = {one.layout for one in each}
    if len(layouts) > 1:
        raise ValueError("data: expected the same number of channels in all, got different ones")
    layout = layouts.pop()
    channels: list[Any] = [one for images in each for one in images.data]
    return GrayImages(channels, Layout((len(data), *layout.shape), layout.channel_axis))


def gray_images(data: PreparedData) -> GrayImages:
    """Return the gray images of data that :func:`prepare_data` returned."""
    if isinstance(data, GrayImages):
        return data
    if isinstance(data, Bits | Readings | Merged):
        channels: list[Any] = list(data.channels())
        is_color = len(data.shape) > (2 if isinstance(data, Merged) else 3)
        return GrayImages(channels, Layout((len(channels),), -1) if is_color else Layout())
    return GrayImages(data[None], Layout())


def count_pixels(data: GrayData, sensor: Sensor, threads: int | None) -> PixelCounts:
    """Return the pixel counts of bits or merged counts (H, W), or of counts (H, W) or (N, H, W).

    Dead jots do not count. Merged counts state what they are for their own pixels.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together, or a count is above K.
    """
    check_threads(threads)
    if isinstance(data, Merged):
        refuse_finer_grid(data)
        return PixelCounts(
            sensor,
            data.ones,
            constant_or_map(data.trials),
            constant_or_map(data.efficiency),
            constant_or_map(data.dark_counts),
            varies_within_pixels=False,
        )
    if isinstance(data, Bits):
        check_fits(data.shape, sensor)
        ones = count_ones([data], sensor.oversampling, sensor.mask, threads)
        return describe_pixels(ones[0], sensor)
    if isinstance(data, Readings):
        check_fits(data.shape, sensor, bit_depth=data.bit_depth)
    counts = as_counts(data)
    _check_jots(counts, sensor)
    if sensor.mask is not None:
        counts = np.where(sensor.mask, np.int32(0), counts)
    check_range(counts, sensor)
    return describe_pixels(counts, sensor)


def describe_pixels(counts: npt.NDArray[np.int32], sensor: Sensor) -> PixelCounts:
    """Return counts with the parameters of their pixels, which are those of the sensor."""
    mask, side = sensor.mask, sensor.oversampling
    trials: Any = sensor.trials
    if mask is not None:
        trials = Bits.from_array(~mask).counts(side).astype(np.float64) * sensor.frames
    efficiency, efficiency_varies = pixel_means(sensor.efficiency, mask, side)
    dark, dark_varies = mean_dark_counts(sensor.dark_counts, mask, side, sensor.threshold)
    trials, efficiency, dark = (
        np.broadcast_to(value, counts.shape) if isinstance(value, np.ndarray) else value
        for value in (trials, efficiency, dark)
    )
    return PixelCounts(sensor, counts, trials, efficiency, dark, efficiency_varies or dark_varies)


def _check_jots(counts: npt.NDArray[np.int32], sensor: Sensor) -> None:
    """Check that the maps of a sensor fit the counts, which do not distinguish jots."""
    sensor.check_map_shapes(*(size * sensor.oversampling for size in counts.shape[-2:]))
    if sensor.oversampling > 1 and sensor.mask is not None:
        raise ValueError(
            "counts: with a mask of single jots the bits are needed, because a count does not "
            "say which jots reported 1; pass the bits, or a sensor without a mask"
        )
