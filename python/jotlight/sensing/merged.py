"""Counts whose pixels may have different numbers of trials."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from jotlight.arrays import HasReadOnlyArrays, frozen
from jotlight.checks import as_counts, positive_number, to_array, whole_number_in_range
from jotlight.errors import plural
from jotlight.layout import Layout
from jotlight.notebook import card, normalize
from jotlight.sensing.bits.channels import channel_views
from jotlight.sensing.bits.values import checked_trials, extent, numbers_from_zero
from jotlight.sensing.parameters.maps import pixel_means
from jotlight.sensing.parameters.reading_groups import require_plain_bits
from jotlight.sensing.sensor import Sensor

MAX_SILENT_TRIALS = 0.01
"""Maximum number of trials of a pixel that says nothing, but is not dead."""

MERGE_AGAIN = (
    "merge the readings again with a larger max_intensity, which is an argument of "
    "FreeRunning.merge, and a parameter of the sensor of merge_readings"
)
"""What to do with equivalent counts of a scene that is too bright for them."""

_OF_PIXELS = {"mask": None, "dark_counts": 0.0, "efficiency": 1.0}
"""Parameters of the sensor that merged counts state for each pixel, and their default values."""

_TOLERANCE = 1e-5
"""Relative difference that does not count: such as of a map that was rounded to float32."""


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Merged(HasReadOnlyArrays):
    """Counts of pixels with different numbers of trials, such as bits merged along a motion.

    All methods and all tied networks accept merged counts. Only K-conditioned networks accept those
    of a finer grid.

    Parameters
    ----------
    ones : array_like of int, shape (H, W)
        L: the number of ones of each pixel. With `channel_axis` also of each color channel.
    trials : float or array_like of float
        n: the number of binary readings behind each pixel, a real number from 0 upward or a map of
        the shape of `ones`. It may be a mean, and 0 marks a pixel without data.
    sensor : Sensor
        The sensor of the data, with one gain and one threshold. Its K is the nominal number of
        trials. Its mask has no effect, because `trials` states the dead pixels.
    dark_counts : float or array_like of shape (H, W), optional
        d: the dark counts of the bits behind each pixel. For threshold 1, the value that causes as
        many ones as the bits have, -log of the mean of exp(-d) over them. For other thresholds, the
        mean. Default: the sensor's.
    efficiency : float or array_like of shape (H, W), optional
        η: the mean of the efficiency over the bits behind each pixel. Default: the sensor's.
    acceptance : array_like of shape (H, W), optional
        The fraction of the bits along the motion that were counted, in [0, 1].
    posterior_error : array_like of shape (H, W), optional
        How well the bits near a pixel determine the displacement: its standard deviation by one
        tile and one block alone, 0 or more, in jots, or in pixels of a finer grid. The true error
        is smaller.
    flags : array_like of bool, shape (H, W), optional
        True marks a pixel that is not to be trusted.
    channel_axis : int, optional
        Axis of `ones`, and of a map of `trials`, that holds color channels. It becomes the last
        axis. Default: none.
    upsample : {1, 2}
        2 for the finer grid of :func:`jotlight.merge`: each reading integrates over the 2 x 2
        pixels from its own to the next ones in rows and columns. Only K-conditioned networks
        estimate the image of such counts.
    light_share : float, optional
        The light of a trial as a share of that of a frame, above 0. Units of photons per frame need
        it. It is 1 unless the counts are equivalent ones, and None if the gains of frames differ.
    valid_up_to : float
        The largest intensity at which the counts say as much as the readings, above 0. Equivalent
        counts have one, and the sensor of an estimate may not exceed it. Default: infinity.

    Raises
    ------
    TypeError, ValueError
        When a value is out of range, an array has the wrong shape or type, or a number of ones
        exceeds its trials.

    Examples
    --------
    >>> merged = jl.Merged([[3, 1]], [[4.0, 2.0]], jl.Sensor(frames=4, max_intensity=9.0))
    >>> jl.mle(merged).round(3).tolist()  # -log(1 - 3/4) and -log(1 - 1/2)
    [[1.38600003..., 0.69300001...]]
    """

    ones: npt.NDArray[np.int32]
    trials: float | npt.NDArray[np.float64]
    sensor: Sensor
    dark_counts: float | npt.NDArray[np.float64]
    efficiency: float | npt.NDArray[np.float64]
    acceptance: npt.NDArray[np.float32] | None
    posterior_error: npt.NDArray[np.float32] | None
    flags: npt.NDArray[np.bool_] | None
    channel_axis: int | None
    upsample: int
    light_share: float | None
    valid_up_to: float

    def __init__(
        self,
        ones: npt.ArrayLike,
        trials: npt.ArrayLike,
        sensor: Sensor,
        *,
        dark_counts: npt.ArrayLike | None = None,
        efficiency: npt.ArrayLike | None = None,
        acceptance: npt.ArrayLike | None = None,
        posterior_error: npt.ArrayLike | None = None,
        flags: npt.ArrayLike | None = None,
        channel_axis: int | None = None,
        upsample: int = 1,
        light_share: float | None = 1.0,
        valid_up_to: float = math.inf,
    ) -> None:
        if not isinstance(sensor, Sensor):
            raise TypeError(f"sensor: expected a jotlight.Sensor, got {type(sensor).__name__}")
        require_plain_bits(sensor)
        upsample = whole_number_in_range("upsample", upsample, 1, 2)
        if light_share is not None:
            positive_number("light_share", light_share)
        if valid_up_to != math.inf:
            positive_number("valid_up_to", valid_up_to)
        counts, numbers = _checked_counts(ones, trials, channel_axis)
        shape = counts.shape[:2]
        checked = {
            "ones": counts,
            "trials": numbers,
            "sensor": sensor,
            "dark_counts": _jot_parameter("dark_counts", dark_counts, sensor, shape),
            "efficiency": _jot_parameter("efficiency", efficiency, sensor, shape),
            "acceptance": _checked_map("acceptance", acceptance, shape, 1.0),
            "posterior_error": _checked_map("posterior_error", posterior_error, shape, np.inf),
            "flags": _checked_flags(flags, shape),
            "channel_axis": None if channel_axis is None else -1,
            "upsample": upsample,
            "light_share": light_share,
            "valid_up_to": valid_up_to,
        }
        fractions = np.asarray(checked["efficiency"])
        if not ((fractions > 0) & (fractions <= 1)).all():
            raise ValueError(
                "efficiency: expected numbers above 0 and up to 1, got "
                f"{fractions.min()} to {fractions.max()}"
            )
        for name, value in checked.items():
            # The caller may change an array that the check above does not copy.
            own = frozen(value) if isinstance(value, np.ndarray) else value
            object.__setattr__(self, name, own)

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W), or (H, W, C) for color."""
        return self.ones.shape

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> NoReturn:
        """Raise TypeError, because the counts and the trials are two arrays."""
        raise TypeError(
            "expected an array, got Merged; merged.ones and merged.trials are its arrays, and "
            "jotlight.reconstruct(merged) returns an image"
        )

    def channels(self) -> Iterator[Merged]:
        """Yield the gray counts of each channel."""
        if self.ones.ndim == 2:
            yield self
            return
        trials = self.trials
        for index, ones in enumerate(channel_views(self.ones)):
            own = trials[..., index] if isinstance(trials, np.ndarray) else trials
            gray = np.ascontiguousarray(ones)
            yield dataclasses.replace(self, ones=gray, trials=own, channel_axis=None)

    def _repr_html_(self) -> str:
        facts: dict[str, object] = {
            "size": " x ".join(map(str, self.shape)),
            "trials": extent(self.trials),
            "sensor": self.sensor,
        }
        if self.acceptance is not None:
            facts["bits used"] = f"{self.acceptance.mean():.1%}"
        if self.flags is not None:
            facts["flagged pixels"] = f"{self.flags.mean():.1%}"
        fraction = self.ones / np.maximum(self.trials, 1)
        return card("Merged", {**facts, "image": "the fraction of ones"}, normalize(fraction))

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.shape))
        trials = f"{extent(self.trials)} {plural(float(np.max(self.trials)), 'trial')}"
        return f"<Merged: {size}, {trials}, {self.sensor!r}>"


def is_finer(data: object) -> bool:
    """Return whether data are merged counts on a finer grid than that of the jots."""
    return isinstance(data, Merged) and data.upsample > 1


def refuse_finer_grid(merged: Merged) -> None:
    """Raise ValueError for merged counts whose readings overlap, on a finer grid than the jots'."""
    if is_finer(merged):
        raise ValueError(
            "data: expected counts of single pixels, got those of a finer grid, whose readings "
            "integrate over 2 x 2 pixels; take a K-conditioned network such as "
            "jotlight.pretrained(merged.sensor), or merge with upsample=1"
        )


def check_sensor_of_merged(data: Iterable[object], sensor: Sensor) -> None:
    """Raise ValueError if a sensor of plain bits contradicts the merged counts among some data.

    Merged counts state the jots behind each pixel. So another mask, other dark counts, or another
    efficiency would have no effect. Default values state nothing. Nothing takes merged counts for
    those of other sensors.

    Examples
    --------
    >>> merged = jl.Merged([[3, 1]], 4.0, jl.Sensor(frames=4))
    >>> check_sensor_of_merged([merged], merged.sensor.replace(max_intensity=2.0))
    >>> check_sensor_of_merged([merged], merged.sensor.replace(mask=[[True, False]]))
    Traceback (most recent call last):
      ...
    ValueError: mask: expected that of the sensor of the merged counts, got another one; ...
    """
    for merged in data:
        if not isinstance(merged, Merged) or not sensor.has_plain_bits:
            continue
        for name, default in _OF_PIXELS.items():
            if _differs(getattr(merged.sensor, name), getattr(sensor, name), default):
                raise ValueError(
                    f"{name}: expected that of the sensor of the merged counts, got another one; "
                    "leave out the sensor, or pass it where the readings are merged, to "
                    "jotlight.merge or merge_readings (FreeRunning.merge has mask=)"
                )
        if sensor.max_intensity > merged.valid_up_to:
            raise ValueError(
                f"max_intensity: expected at most {merged.valid_up_to:g}, up to which the "
                f"equivalent counts are valid, got {sensor.max_intensity:g}; {MERGE_AGAIN}"
            )


def _differs(own: Any, other: Any, default: float | None) -> bool:
    """Return whether a parameter of a sensor contradicts another one. A default states nothing."""
    if other is None or (np.ndim(other) == 0 and other == default):
        return False
    if own is None or (np.ndim(own) and np.ndim(other) and own.shape != other.shape):
        return True
    return not np.allclose(own, other, rtol=_TOLERANCE, atol=0)


def _checked_counts(
    ones: npt.ArrayLike, trials: npt.ArrayLike, channel_axis: int | None
) -> tuple[npt.NDArray[np.int32], float | npt.NDArray[np.float64]]:
    """Return ones and trials after checks, with the axis of channels last."""
    counts = as_counts(ones)
    if Layout.of("ones", counts, channel_axis).is_stack:
        raise ValueError(
            "ones: expected shape (H, W), or (H, W, C) with channel_axis=-1, got "
            f"{counts.shape}; pass a list of Merged for a stack"
        )
    numbers = checked_trials(trials, counts)
    if channel_axis is not None:
        counts = np.moveaxis(counts, channel_axis, -1)
        if isinstance(numbers, np.ndarray):
            numbers = np.moveaxis(numbers, channel_axis, -1)
    return counts, numbers


def _jot_parameter(
    name: str, given: npt.ArrayLike | None, sensor: Sensor, shape: tuple[int, ...]
) -> Any:
    """Return the dark counts or the efficiency of the pixels: those given, or the sensor's."""
    if given is not None:
        values = numbers_from_zero(name, given)
        if values.ndim == 0:
            return values.item()
        _check_shape(name, values, shape)
        return values
    value = getattr(sensor, name)
    if isinstance(value, np.ndarray):
        sensor.check_map_shapes(*(size * sensor.oversampling for size in shape))
    mean, varies = pixel_means(value, sensor.mask, sensor.oversampling)
    if varies:
        raise ValueError(
            f"{name}: expected the mean of each pixel, because its jots differ; pass a map of "
            f"shape {shape} with {_mean_over_bits(name, sensor)} behind each pixel"
        )
    return mean


def _mean_over_bits(name: str, sensor: Sensor) -> str:
    """Return which mean over the bits a map of a parameter holds."""
    if name == "dark_counts" and sensor.threshold == 1:
        return "-log of the mean of exp(-d) over the bits"
    return "the mean over the bits"


def _checked_map(
    name: str, values: npt.ArrayLike | None, shape: tuple[int, ...], maximum: float
) -> npt.NDArray[np.float32] | None:
    if values is None:
        return None
    array = to_array(name, values)
    _check_shape(name, array, shape)
    if array.dtype.kind not in "iuf" or not ((array >= 0) & (array <= maximum)).all():
        limit = "1" if maximum == 1 else "infinity"
        raise ValueError(f"{name}: expected numbers from 0 to {limit} without NaN")
    return np.require(array, np.float32, ["C", "ALIGNED"])


def _checked_flags(
    flags: npt.ArrayLike | None, shape: tuple[int, ...]
) -> npt.NDArray[np.bool_] | None:
    if flags is None:
        return None
    array = to_array("flags", flags)
    _check_shape("flags", array, shape)
    if array.dtype != np.bool_:
        raise TypeError(f"flags: expected an array of bool, got {array.dtype}")
    return array


def _check_shape(name: str, array: npt.NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name}: expected one value per pixel, shape {shape}, got {array.shape}")
