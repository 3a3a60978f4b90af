"""The sensor: its parameters, and the physics that leads from an image to bits."""

from __future__ import annotations

import dataclasses
from typing import Any, Self, SupportsFloat, SupportsIndex, cast

import numpy as np
import numpy.typing as npt

from jotlight.arrays import HasReadOnlyArrays
from jotlight.checks import number_in_range, shown
from jotlight.parameter_names import check_choice, require_names
from jotlight.sensing.drawing.exposure import Exposure
from jotlight.sensing.drawing.simulate import EnginePart
from jotlight.sensing.parameters import reading_groups
from jotlight.sensing.parameters.maps import LIMITS
from jotlight.sensing.parameters.reading_groups import ReadingGroup
from jotlight.sensing.parameters.response import JotResponse, PixelResponse
from jotlight.sensing.parameters.sensor_checks import SYNONYMS, checked_parameters

KERNELS = ("box", "linear", "quadratic", "cubic")
"""The B-spline kernels of the light field, in the order of their degree."""


@require_names("Sensor(frames=16)", SYNONYMS)
@dataclasses.dataclass(frozen=True, eq=False, repr=False, init=False)
class Sensor(Exposure, HasReadOnlyArrays):
    """A quanta image sensor: each jot reports 1 when it detects at least `threshold` photons.

    Readings of several bits state the number of photons (`bit_depth`).

    The jots receive the *light* ``s = (gain / frames) * (G c)`` of an image c: the expected number
    of photons per jot and frame. G spreads the light of each pixel over the jots, with the kernel
    `kernel`. The sensor detects photons at the *rate* ``efficiency * s + dark_counts`` per jot and
    frame. With the defaults, each jot of a pixel of intensity 1 receives one photon per frame on
    average.

    Parameters
    ----------
    oversampling : int
        K̂: each pixel covers K̂ x K̂ jots.
    frames : int
        T: the number of binary frames of the same scene.
    gain : float or array_like of shape (T,), optional
        α: the expected photons on a pixel of intensity 1, over all its jots and frames, 1e-18 per
        frame to 1e18. An array states the photons of each frame, as of a bracket of exposures;
        their sum is α. Default: K, the number of trials per pixel.
    threshold : int or array_like of shape (T,) or (H * K̂, W * K̂)
        q: the minimum number of photons for which a jot reports 1, 1 to 65535: a number, one for
        each frame, or a map with one for each jot.
    kernel : {"box", "linear", "quadratic", "cubic"}
        The B-spline that spreads a pixel's light. The box keeps it on the pixel's own jots. If K̂ is
        odd, "linear" and "cubic" also move it half a jot down and right: half a pixel if K̂ = 1.
    dark_counts : float or array_like of shape (H * K̂, W * K̂)
        d: the expected detections per jot and frame without light, 0 to 1e18, a number or a map.
    efficiency : float or array_like of shape (H * K̂, W * K̂)
        η: the fraction of the photons that a jot detects, 1e-18 to 1, a number or a map.
    mask : array_like of bool of shape (H * K̂, W * K̂), optional
        True marks a dead jot, as in `numpy.ma`. A dead jot always reports 0 in simulation, and
        reconstruction ignores it.
    max_intensity : float
        S: the largest intensity that an estimate may have, 1e-18 to 1e18.
    exposure_time : float, optional
        The exposure time of a frame in seconds, which photons per second need. Default: unknown.
    bit_depth : int
        b: the bits of a reading, 1 to 16. With several bits, a reading is the number of photons, at
        most 2^b - 1, and `threshold` must be 1.
    read_noise : float
        σ: the standard deviation of the noise that is added to the number of photons before
        rounding, in photons: 0, or 0.001 to 100. A reading is round(Y + σ N), clipped to
        0 ... 2^b - 1; one of one bit is whether round(Y + σ N) is at least `threshold`.
    mosaic : str, array_like, or jotlight.Mosaic, optional
        The color filter of each pixel, which covers all of its K̂ x K̂ jots: letters such as
        ``"RGGB"``, or anything that a Mosaic takes. The image is then red, green, and blue,
        (H, W, 3), and so is the estimate. The kernel must be the box. Default: a gray sensor.

    Raises
    ------
    TypeError
        When a parameter is passed without its name.
    ValueError
        When a value is out of range, or a map has the wrong shape or values.

    Notes
    -----
    Paper, section 2.1, equations (2) and (3), which leave out efficiency and dark counts.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=4, threshold=2)
    >>> sensor.trials, sensor.gain
    (16, 16.0)
    >>> round(float(sensor.probability(np.ones((1, 1)))[0, 0]), 4)  # two photons or more at s = 1
    0.2642
    """

    oversampling: int
    frames: int
    # Code for arrays of these two asks `readings_differ` before.
    gain: float
    threshold: int
    kernel: str
    dark_counts: float | npt.NDArray[np.float32]
    efficiency: float | npt.NDArray[np.float32]
    mask: npt.NDArray[np.bool_] | None
    max_intensity: float
    exposure_time: float | None
    bit_depth: int
    read_noise: float
    mosaic: Any  # a Mosaic, or None

    def __init__(
        self,
        *,
        oversampling: SupportsIndex = 1,
        frames: SupportsIndex = 1,
        gain: npt.ArrayLike | None = None,
        threshold: npt.ArrayLike = 1,
        kernel: str = "box",
        dark_counts: npt.ArrayLike = 0.0,
        efficiency: npt.ArrayLike = 1.0,
        mask: npt.ArrayLike | None = None,
        max_intensity: SupportsFloat = 1.0,
        exposure_time: SupportsFloat | None = None,
        bit_depth: SupportsIndex = 1,
        read_noise: SupportsFloat = 0.0,
        mosaic: object = None,
    ) -> None:
        check_choice("kernel", kernel, KERNELS)
        given = {
            "oversampling": oversampling,
            "frames": frames,
            "gain": gain,
            "threshold": threshold,
            "kernel": kernel,
            "dark_counts": dark_counts,
            "efficiency": efficiency,
            "mask": mask,
            "max_intensity": max_intensity,
            "exposure_time": exposure_time,
            "bit_depth": bit_depth,
            "read_noise": read_noise,
            "mosaic": mosaic,
        }
        for name, value in checked_parameters(given).items():
            object.__setattr__(self, name, value)

    @property
    def trials(self) -> int:
        """K = T·K̂²."""
        return self.frames * self.oversampling**2

    @property
    def light_per_intensity(self) -> float:
        """α/K: the light of a jot (photons per frame) at intensity 1, with the box kernel.

        If each frame has its own gain, there is no such number, and this raises ValueError.
        """
        if isinstance(cast(Any, self.gain), np.ndarray):
            reading_groups.refuse_different_readings(self)
        return self.gain / self.trials

    @property
    def readings_differ(self) -> bool:
        """Whether the gain or the threshold has a value for each frame, or for each jot."""
        return reading_groups.readings_differ(self)

    @property
    def max_reading(self) -> int:
        """The largest reading, 2^b - 1."""
        return int(2**self.bit_depth - 1)

    @property
    def has_plain_bits(self) -> bool:
        """Whether readings are bits with one gain and one threshold, without read noise.

        The count of the ones of a pixel then has all information of its bits.
        """
        return reading_groups.has_plain_bits(self)

    def groups(self) -> list[ReadingGroup[Self]]:
        """Return the readings with equal gain and threshold: their frames and their sensor.

        Examples
        --------
        >>> groups = jl.Sensor(frames=3, gain=[1.0, 8.0, 1.0]).groups()
        >>> [(group.frames.tolist(), group.sensor) for group in groups]
        [([0, 2], Sensor(frames=2)), ([1], Sensor(gain=8.0))]
        """
        return reading_groups.group_readings(self)

    def select_frames(self, frames: slice) -> Self:
        """Return the sensor of some of the frames.

        Examples
        --------
        >>> jl.Sensor(frames=4, gain=[1.0, 8.0, 1.0, 8.0]).select_frames(slice(None, None, 2))
        Sensor(frames=2)
        """
        return reading_groups.select_frames(self, frames)

    def replace(self, **changes: Any) -> Self:
        """Return a sensor with some parameters changed. Unless `gain` is changed, α/K is kept.

        For example, ``sensor.replace(frames=16)`` records 16 frames, each as bright as before, as
        does ``copy.replace`` of Python 3.13. ``dataclasses.replace`` keeps α in place of α/K.

        Examples
        --------
        >>> jl.Sensor(oversampling=2, gain=2.0).replace(frames=3).gain
        6.0
        """
        changes = reading_groups.replaced_gain(self, changes)
        # Read noise that does not change is not warned about again.
        same = {} if "read_noise" in changes else {"read_noise": 0.0}
        new = dataclasses.replace(self, **{"gain": None, **same, **changes})
        if same:
            object.__setattr__(new, "read_noise", self.read_noise)
        if "gain" not in changes:
            gain = self.light_per_intensity * new.trials
            object.__setattr__(new, "gain", number_in_range("gain", gain, *LIMITS))
        return new

    def __replace__(self, **changes: Any) -> Self:
        """Return :meth:`replace`, for ``copy.replace`` of Python 3.13."""
        return self.replace(**changes)

    def without_white_balance(self) -> Self:
        """Return the sensor whose estimates are intensities, in the units of the scene.

        Examples
        --------
        >>> from jotlight.sensing.parameters.mosaic import Mosaic
        >>> jl.Sensor(mosaic=Mosaic("RGGB", white_balance=[1.2, 1, 1.5])).without_white_balance()
        Sensor(mosaic=Mosaic('RGGB'))
        """
        if self.mosaic is None:
            return self
        return self.replace(mosaic=self.mosaic.without_white_balance(), gain=self.gain)

    def engine_arguments(self) -> dict[str, Any]:
        """Return the sensor as the engine's simulation expects it."""
        reading_groups.refuse_different_readings(self)
        return {
            "response": self.jot_response(),
            "oversampling": self.oversampling,
            "kernel_degree": KERNELS.index(self.kernel),
            "gain_per_frame": self.gain / self.frames,
            "efficiency": self.efficiency,
            "dark_counts": self.dark_counts,
            "dead": self.mask,
            "threshold": self.threshold,
        }

    def engine_parts(self) -> list[EnginePart]:
        """Return the groups of equal readings as the engine's simulation expects them."""
        if not self.readings_differ:
            return [EnginePart(None, self.engine_arguments())]
        by_frame = reading_groups.frames_differ(self)
        return [
            EnginePart(group.frames if by_frame else None, group.sensor.engine_arguments())
            for group in self.groups()
        ]

    def jot_response(self) -> JotResponse:
        """Return how a jot turns photons into a reading."""
        reading_groups.refuse_different_readings(self)
        return JotResponse(self.max_reading, self.read_noise, self.threshold)

    def pixel_response(self) -> PixelResponse:
        """Return the response of a pixel with the box kernel."""
        reading_groups.require_plain_bits(self)
        return PixelResponse(self.threshold, self.light_per_intensity, self.max_intensity)


def require_any_sensor(sensor: object) -> None:
    """Raise TypeError unless the argument is a sensor.

    Examples
    --------
    >>> require_any_sensor(8)
    Traceback (most recent call last):
      ...
    TypeError: sensor: expected a jotlight.Sensor, such as Sensor(frames=16) ..., got 8
    """
    if not isinstance(sensor, Sensor):
        raise TypeError(
            "sensor: expected a jotlight.Sensor, such as Sensor(frames=16) for 16 trials per "
            f"pixel, got {shown(sensor)}"
        )


def require_trainable(sensor: Sensor) -> None:
    """Raise ValueError unless networks can be built, trained, or fine-tuned for a sensor.

    Anything but a sensor is a TypeError.

    Examples
    --------
    >>> require_trainable(jl.Sensor(frames=4, bit_depth=4))
    Traceback (most recent call last):
      ...
    ValueError: sensor: expected a gray sensor with bits ..., got Sensor(frames=4, bit_depth=4); ...
    """
    require_any_sensor(sensor)
    if sensor.mosaic is not None or not sensor.has_plain_bits:
        raise ValueError(
            "sensor: expected a gray sensor with bits of one gain and threshold, without read "
            f"noise, for a network of its own, got {sensor!r}; reconstruct takes this sensor with "
            "the networks that come with jotlight"
        )


def require_sensor(
    sensor: object, *, may_differ: bool = False, takes_mosaics: bool = False
) -> None:
    """Raise TypeError unless the argument is a sensor, and ValueError unless it has plain bits.

    The sensor must be gray unless `takes_mosaics` is true. Its readings may differ if `may_differ`
    is true.
    """
    require_any_sensor(sensor)
    assert isinstance(sensor, Sensor)
    advice = reading_groups.COUNTS_ADVICE if sensor.mosaic is None else reading_groups.MOSAIC_ADVICE
    if takes_mosaics:
        sensor = reading_groups.without_mosaic(sensor)
    reading_groups.refuse_mosaic(sensor)
    if not may_differ:
        reading_groups.require_plain_bits(sensor, advice)
