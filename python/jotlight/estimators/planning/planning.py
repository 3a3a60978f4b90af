"""The expected quality of `jotlight.mle` before a capture: exact bias, error, bound, and PSNR."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import number_in_range, positive_number, shown, to_array, whole_number_in_range
from jotlight.estimators.inverse_response import warn_about_smooth_kernel
from jotlight.estimators.planning.figure import draw_psnr, draw_snr
from jotlight.estimators.planning.planned_bits import PlannedBits
from jotlight.estimators.planning.planned_motion import MotionPlan, check_motion, plan_motion
from jotlight.estimators.planning.planned_pixel import PlannedPixel
from jotlight.estimators.planning.planned_readings import PlannedReadings
from jotlight.notebook import card, table_of
from jotlight.sensing.likelihood.reference import sensor_of_median_jot
from jotlight.sensing.parameters.reading_groups import refuse_different_readings
from jotlight.sensing.sensor import Sensor, require_sensor
from jotlight.underflow import underflows_to_0

if TYPE_CHECKING:
    from jotlight.figures import Figure

_LEVELS = 25
"""The number of levels of light in a range."""

_NODES = 20
"""The number of Gauss-Legendre nodes for the mean error over a range of light."""

_SATURATED_FRACTION = 0.01
"""Fraction of pixels with only the largest reading, at the saturation light."""

_MAX_ROWS = 20
"""The maximum number of rows of the table in notebooks."""

_MAX_BITS = 2**31 - 1
"""The maximum number of trials per pixel."""


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """The expected quality of `jotlight.mle` for N levels of light and M numbers of frames.

    Light, bias, and errors are in photons per jot and frame, and PSNR and SNR are in dB.

    Attributes
    ----------
    light : ndarray of float64
        The levels of light in ascending order, (N,).
    frames : ndarray of int64
        The numbers of frames, (M,).
    bias : ndarray of float64
        The mean error of the estimated light for each number of frames and level, (M, N).
    rmse : ndarray of float64
        The root mean square error of the estimated light, which includes the bias, (M, N).
    cramer_rao_bound : ndarray of float64
        The Cramér-Rao bound, (M, N): the minimum standard deviation of an unbiased estimate.
    psnr : ndarray of float64
        The PSNR in dB, (M,), of a scene with uniformly distributed light. Peak: the maximum.
    saturation_light : ndarray of float64
        The light at which all bits are 1 in 1 % of the pixels, (M,).
    optimal_light : float
        The light at which a bit is most informative, so that the bound on the SNR is highest.
    target_psnr : float, optional
        The requested PSNR in dB.
    required_frames : int, optional
        The number of frames that reaches the requested PSNR, or None if no number does.
    motion : MotionPlan, optional
        The quality at the given speed of the scene, or None without a speed.
    """

    light: Array
    frames: npt.NDArray[np.int64]
    bias: Array
    rmse: Array
    cramer_rao_bound: Array
    psnr: Array
    saturation_light: Array
    optimal_light: float
    target_psnr: float | None = None
    required_frames: int | None = None
    motion: MotionPlan | None = None

    @property
    def snr(self) -> Array:
        """The light over the root mean square error in dB, (M, N)."""
        return _decibels(self.light / self.rmse)

    @property
    def snr_bound(self) -> Array:
        """The light over the Cramér-Rao bound in dB, (M, N)."""
        return _decibels(self.light / self.cramer_rao_bound)

    def plot(self) -> Figure:
        """Return a figure of the PSNR over the frames, and of the SNR over the light."""
        from jotlight.figures import Figure

        figure = Figure(10, 4)
        left, right = figure.subplots(1, 2)
        draw_psnr(left, self.frames, self.psnr, self.target_psnr)
        draw_snr(right, self.light, self.frames, self.snr, self.snr_bound)
        return figure

    def _facts(self) -> dict[str, str]:
        low, high = self.light[[0, -1]]
        light = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
        facts = {"light": f"{light} photons per jot and frame"}
        if self.target_psnr is not None:
            required = "no number" if self.required_frames is None else f"{self.required_frames:,}"
            facts[f"frames for {self.target_psnr:g} dB"] = required
        return facts

    def _repr_html_(self) -> str:
        facts = {**self._facts(), "best light": f"{self.optimal_light:.3g}"}
        places = sorted({0, len(self.light) // 2, len(self.light) - 1})
        titles = ["frames", "PSNR, dB", *(f"SNR at {self.light[i]:.3g}, dB" for i in places)]
        rows = [
            (f"{frames:,}", f"{psnr:.1f}", *(f"{snr[place]:.1f}" for place in places))
            for frames, psnr, snr in zip(self.frames, self.psnr, self.snr, strict=True)
        ]
        drawing = self.plot().thumbnail()
        return card("Plan", facts, drawing) + table_of(titles, rows[-_MAX_ROWS:])

    def __repr__(self) -> str:
        facts = ", ".join(f"{name}: {value}" for name, value in self._facts().items())
        first, last = self.frames[[0, -1]]
        return (
            f"<Plan: {first:,} to {last:,} frames, PSNR {self.psnr[0]:.1f} to {self.psnr[-1]:.1f} "
            f"dB, {facts}>"
        )


@underflows_to_0
def plan(
    sensor: Sensor,
    light: float | tuple[float, float],
    *,
    frames: Sequence[int] | None = None,
    target_psnr: float | None = None,
    max_intensity: float | None = None,
    speed: float | None = None,
    size: tuple[int, int] = (256, 512),
) -> Plan:
    """Return the expected quality of `jotlight.mle` as a function of the number of frames.

    Parameters
    ----------
    sensor : Sensor
        The sensor. Its number of frames has no effect. Medians of the live jots replace its maps.
    light : float or (float, float)
        Photons per jot and frame, in (0, 10,000]: one level, or the minimum and maximum of a scene.
        If the efficiency is a map, such as that of a calibration, they are photons that the median
        jot detects, because a calibration knows only ratios of efficiencies.
    frames : sequence of int, optional
        The numbers of frames. Default: the powers of two from 1 to 4096.
    target_psnr : float, optional
        A PSNR in dB, in [0, 200]. The plan then includes the number of frames that reaches it.
    max_intensity : float, optional
        S of the estimates. Default: for each number of frames, the intensity half a count below
        saturation, which is the default of ``jotlight reconstruct`` for captures. It is 0 where
        dark counts alone saturate the bits.
    speed : float, optional
        Pixels per frame, in [0, 1000], for a plan of how many frames help if the scene moves.
    size : (int, int)
        H and W in pixels, for `speed`.

    Returns
    -------
    Plan

    Raises
    ------
    TypeError, ValueError
        When a number is out of its range.

    Notes
    -----
    Bias and error of bits are exact sums over the binomial distribution of a count. Where few bits
    are 0 or few are 1, the estimate is biased, and its error may be below the bound of unbiased
    estimates.

    With several bits or read noise, the error is that of a statistic close to the estimate
    (:mod:`jotlight.estimators.planning.planned_estimates`). For fewer than 64 readings, it differs
    from that of `jotlight.mle` by up to 0.6 dB, or by up to 1.5 dB where the SNR is below 0 dB.
    From 64 readings on, it differs by less than 0.3 dB. With a read noise of 0.3 or more and an SNR
    (light over error) below 10 dB, a saddle-point approximation of the distribution of the estimate
    (:mod:`jotlight.estimators.planning.saddle_point`) differs by at most 0.6 dB, and by up to 1.3
    dB for one reading. It needs the default S, or a smaller one. With a larger S, and with less
    read noise, plans are up to 16 dB too optimistic at a thousandth of a photon. For bits with read
    noise, plans are exact.

    To find `required_frames`, the search doubles the number of frames and then bisects. Below about
    10 dB, fewer may suffice. Methods that combine neighboring pixels need fewer frames.

    Examples
    --------
    >>> expected = jl.plan(jl.Sensor(), (0.05, 1.0), frames=[16, 256], target_psnr=30.0)
    >>> expected.psnr.round(1).tolist(), expected.required_frames
    ([12.3, 25.3], 758)
    """
    require_sensor(sensor, may_differ=True)
    refuse_different_readings(
        sensor, "state one of each; jotlight.plan_brackets finds exposures that differ"
    )
    warn_about_smooth_kernel(sensor)
    levels = _light_levels(light)
    max_frames = _MAX_BITS // sensor.oversampling**2
    numbers = _frame_numbers(frames, max_frames)
    if target_psnr is not None:
        target_psnr = number_in_range("target_psnr", target_psnr, 0, 200)
    check_motion(0 if speed is None else speed, size)
    if max_intensity is not None:
        max_intensity = positive_number("max_intensity", max_intensity)
    sensor = sensor_of_median_jot(sensor)
    pixel: PlannedPixel
    if sensor.has_plain_bits:
        pixel = PlannedBits(sensor, max_intensity)
    else:
        pixel = PlannedReadings(sensor, max_intensity, float(levels[-1]))
    scene = _Scene(pixel, levels[0], levels[-1])
    errors = [pixel.bias_and_mse(int(number), levels) for number in numbers]
    information = [pixel.information(levels) * number * pixel.jots for number in numbers]
    required = None if target_psnr is None else scene.required_frames(target_psnr, max_frames)
    scale = (sensor.threshold - 1 + sensor.max_reading) / pixel.efficiency
    grid = np.geomspace(1e-4, 1e2, 6001) * scale
    saturation = [pixel.saturation_light(int(number), _SATURATED_FRACTION) for number in numbers]
    with np.errstate(divide="ignore"):  # where all readings are the largest
        bound = 1 / np.sqrt(information)
    return Plan(
        light=levels,
        frames=numbers,
        bias=np.array([bias for bias, _ in errors]),
        rmse=np.sqrt([mse for _, mse in errors]),
        cramer_rao_bound=bound,
        psnr=np.array([scene.psnr(int(number)) for number in numbers]),
        saturation_light=np.array(saturation),
        optimal_light=float(grid[np.argmax(grid**2 * pixel.information(grid))]),
        target_psnr=target_psnr,
        required_frames=required,
        motion=None if speed is None else plan_motion(scene.information, speed, size, numbers),
    )


class _Scene:
    """A scene of such pixels, with light uniformly distributed between two levels."""

    def __init__(self, pixel: PlannedPixel, min_light: float, max_light: float) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        self._pixel, self._max_light = pixel, max_light
        self._levels = min_light + (max_light - min_light) * (nodes + 1) / 2
        self._weights = weights / 2
        if min_light == max_light:
            self._levels, self._weights = np.array([max_light]), np.ones(1)

    @property
    def information(self) -> float:
        """The information of a frame about the intensity of a pixel, if the maximum light is 1.

        It is the inverse of the mean variance, and above 0.
        """
        of_frame = self._pixel.information(self._levels) * self._pixel.jots * self._max_light**2
        with np.errstate(divide="ignore"):
            return max(float(1 / (self._weights @ (1 / of_frame))), 1e-300)

    def psnr(self, frames: int) -> float:
        """Return the PSNR in dB of the estimate from a number of frames."""
        mse = self._pixel.bias_and_mse(frames, self._levels)[1]
        return float(_decibels(self._max_light / np.sqrt(self._weights @ mse)))

    def required_frames(self, target_psnr: float, max_frames: int) -> int | None:
        """Return a number of frames that reaches a PSNR while one frame less does not, or None."""
        above = 1
        while self.psnr(above) < target_psnr:
            if above == max_frames:
                return None
            above = min(2 * above, max_frames)
        below = above // 2
        while above - below > 1:
            middle = (above + below) // 2
            too_few = self.psnr(middle) < target_psnr
            below, above = (middle, above) if too_few else (below, middle)
        return above


def _light_levels(light: float | tuple[float, float]) -> Array:
    levels = to_array("light", light)
    if levels.dtype.kind not in "iuf" or levels.shape not in ((), (1,), (2,)):
        raise TypeError(
            "light: expected a number of photons per jot and frame, or the minimum and the "
            f"maximum such as (0.01, 1), got {light!r}"
        )
    low, high = np.broadcast_to(levels.astype(np.float64), 2)
    if not 0 < low <= high <= 1e4:
        raise ValueError(
            "light: expected photons per jot and frame, the minimum and the maximum, above 0 and "
            f"up to 10,000, got {light!r}"
        )
    return np.array([low]) if low == high else np.geomspace(low, high, _LEVELS)


def _frame_numbers(frames: Sequence[int] | None, max_frames: int) -> npt.NDArray[np.int64]:
    if frames is None:
        return 2 ** np.arange(13)
    if np.ndim(frames) != 1 or len(frames) == 0:
        raise ValueError(f"frames: expected a list such as [16, 256], got {shown(frames)}")
    return np.array([whole_number_in_range("frames", each, 1, max_frames) for each in frames])


def _decibels(ratio: npt.ArrayLike) -> Array:
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(np.asarray(ratio, np.float64)))
