"""How good a picture will be, before it is taken: exact expectations for maximum likelihood."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.sensing.likelihood import Likelihood
from jotlight.sensing.pixel_counts import warn_about_smooth_kernel
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.response import detection_probability, inverse_detection_probability
from jotlight.sensing.sensor import Sensor

Array = npt.NDArray[np.float64]

_LEVELS = 25
"""Levels of light in a range."""

_NODES = 20
"""Levels of light at which the error is found for its mean over a range (Gauss, Legendre)."""

_SIGMAS = 12
"""Standard deviations about the mean of a count beyond which nothing is summed."""

_PER_SIGMA = 100
"""Counts in a standard deviation that are summed, where there are more."""

_SATURATED = 0.01
"""Share of pixels with no bit left at 0 at which saturation is said to begin."""

_MOST_BITS = 2**31 - 1


@dataclasses.dataclass(frozen=True)
class Plan:
    """What `jotlight.mle` may be expected to give; light is in photons per jot and frame."""

    light: Array
    """The levels of light, (N,), from the least to the most."""
    frames: npt.NDArray[np.int64]
    """Numbers of frames, (M,)."""
    bias: Array
    """The mean error of the estimate at each number of frames and level, (M, N), as light."""
    rmse: Array
    """The root mean square error, likewise: its bias and its spread."""
    cramer_rao_bound: Array
    """The Cramér-Rao bound: the least standard deviation of an unbiased estimate."""
    psnr: Array
    """In dB, (M,), of a scene whose light is spread evenly over the range, its most for peak."""
    saturation_light: Array
    """The light at which 1 % of the pixels have every bit at 1, (M,)."""
    optimal_light: float
    """The light at which a bit tells most: where the bound on SNR is highest."""
    target_psnr: float | None = None
    """A PSNR in dB that is asked for."""
    required_frames: int | None = None
    """The frames that reach it, or None if no number of them does."""

    @property
    def snr(self) -> Array:
        """Light over root mean square error in dB, (M, N)."""
        return _decibel(self.light / self.rmse)

    @property
    def snr_bound(self) -> Array:
        """Light over the Cramér-Rao bound in dB, (M, N)."""
        return _decibel(self.light / self.cramer_rao_bound)


def plan(
    sensor: Sensor,
    light: float | tuple[float, float],
    *,
    frames: Sequence[int] | None = None,
    target_psnr: float | None = None,
    max_intensity: float | None = None,
) -> Plan:
    """Expected quality of `jotlight.mle` against the number of frames.

    Parameters
    ----------
    sensor : Sensor
        Its number of frames does not matter; of maps the median of the living jots is taken.
    light : float or (float, float)
        Photons per jot and frame: one level, or the least and the most of a scene.
    frames : sequence of int, optional
        Numbers of frames. Default: 1, 2, 4 and so on to 4096.
    target_psnr : float, optional
        A PSNR in dB; the plan then tells how many frames are enough.
    max_intensity : float, optional
        S of the estimates. Default: for each number of frames the intensity half a count from
        saturation, as ``jotlight reconstruct`` takes it for captures.

    Returns
    -------
    Plan

    Raises
    ------
    ValueError
        When a number is out of its range.

    Notes
    -----
    Bias and error are not simulated but exact: sums over the binomial distribution of a pixel's
    count, of the estimate clipped to [0, S]. Where few bits are 0 or few are 1 the estimate is
    biased, and its error may be below the bound, which holds for unbiased ones.

    `enough` is found by doubling and halving the frames; below some 10 dB, where a few bits a pixel
    may be worse than one, fewer could do. It is for maximum likelihood, pixel by
    pixel; methods that look at neighbours need fewer, how many depends on the scene.

    Examples
    --------
    >>> expected = plan(Sensor(), (0.05, 1.0), frames=[16, 256], target_psnr=30.0)
    >>> expected.psnr.round(1).tolist(), expected.required_frames
    ([12.3, 25.3], 758)
    """
    warn_about_smooth_kernel(sensor)
    levels = _levels(light)
    numbers = np.array([2**n for n in range(13)] if frames is None else frames, np.int64)
    most_frames = _MOST_BITS // sensor.oversampling**2
    if numbers.ndim != 1 or len(numbers) == 0 or not 1 <= numbers.min() <= numbers.max():
        raise ValueError(f"frames: expected whole numbers from 1 on, got {frames!r}")
    if numbers.max() > most_frames:
        raise ValueError(f"frames: expected {most_frames} at most, got {numbers.max()}")
    if target_psnr is not None and not 0 < target_psnr < 200:
        raise ValueError(f"target_psnr: expected a PSNR in dB between 0 and 200, got {target_psnr}")
    if max_intensity is not None and not 0 < max_intensity < np.inf:
        raise ValueError(f"max_intensity: expected a number above 0, got {max_intensity}")
    pixel = _Pixel(sensor, max_intensity)
    rows = [pixel.expected(int(number), levels) for number in numbers]
    scene = _Scene(levels[0], levels[-1])
    seen = [pixel.information(levels) * number * pixel.jots for number in numbers]
    grid = np.geomspace(1e-4, 1e2, 6001) * sensor.threshold
    return Plan(
        light=levels,
        frames=numbers,
        bias=np.array([bias for bias, _ in rows]),
        rmse=np.sqrt([square for _, square in rows]),
        cramer_rao_bound=1 / np.sqrt(seen),
        psnr=np.array([scene.psnr(pixel, int(number)) for number in numbers]),
        saturation_light=np.array([pixel.saturation(int(number)) for number in numbers]),
        optimal_light=float(grid[np.argmax(grid**2 * pixel.information(grid))]),
        target_psnr=target_psnr,
        required_frames=None
        if target_psnr is None
        else scene.enough(pixel, target_psnr, most_frames),
    )


class _Pixel:
    """A pixel whose jots are all alike."""

    def __init__(self, sensor: Sensor, max_intensity: float | None) -> None:
        self.threshold = sensor.threshold
        self.jots = sensor.oversampling**2
        self.efficiency, self.dark = reference_jot(sensor)
        self.most = None if max_intensity is None else max_intensity * sensor.light_per_intensity

    def expected(self, frames: int, levels: Array) -> tuple[Array, Array]:
        """Bias and mean square error of the estimate, clipped, at each level."""
        bits = frames * self.jots
        rates = self.efficiency * levels + self.dark
        chances = detection_probability(self.threshold, rates)
        most = self._light(1 - 0.5 / bits, 0.5 / bits) if self.most is None else self.most
        bias, square = np.empty(len(levels)), np.empty(len(levels))
        for place, (level, chance) in enumerate(zip(levels, chances, strict=True)):
            counts, weights = _binomial(bits, float(chance))
            estimates = np.clip(self._light(counts / bits, (bits - counts) / bits), 0, most)
            bias[place] = weights @ (estimates - level)
            square[place] = weights @ (estimates - level) ** 2
        return bias, square

    def information(self, levels: Array) -> Array:
        """Fisher information of a bit about the light."""
        return Likelihood(
            np.zeros(levels.shape, np.int32),
            threshold=self.threshold,
            efficiency=self.efficiency,
            dark_counts=self.dark,
        ).information(levels)

    def saturation(self, frames: int) -> float:
        # The chance is so near to 1 that its complement has to be found by itself.
        logarithm = np.log(_SATURATED) / (frames * self.jots)
        return float(np.maximum(self._light(np.exp(logarithm), -np.expm1(logarithm)), 0))

    def _light(self, chance: npt.ArrayLike, complement: npt.ArrayLike) -> Array:
        rate = inverse_detection_probability(self.threshold, chance, complement)
        return np.asarray((rate - self.dark) / self.efficiency)


class _Scene:
    """Light spread evenly from the least to the most."""

    def __init__(self, least: float, most: float) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        self.most = most
        self.levels = least + (most - least) * (nodes + 1) / 2
        self.weights = weights / 2
        if least == most:
            self.levels, self.weights = np.array([most]), np.ones(1)

    def psnr(self, pixel: _Pixel, frames: int) -> float:
        square = pixel.expected(frames, self.levels)[1]
        return float(_decibel(self.most / np.sqrt(self.weights @ square)))

    def enough(self, pixel: _Pixel, target_psnr: float, most_frames: int) -> int | None:
        above = 1
        while self.psnr(pixel, above) < target_psnr:
            if above == most_frames:
                return None
            above = min(2 * above, most_frames)
        below = above // 2
        while above - below > 1:
            middle = (above + below) // 2
            short = self.psnr(pixel, middle) < target_psnr
            below, above = (middle, above) if short else (below, middle)
        return above


def _levels(light: float | tuple[float, float]) -> Array:
    least, most = np.broadcast_to(np.asarray(light, np.float64), 2)
    if not 0 < least <= most <= 1e4:
        raise ValueError(
            "light: expected photons per jot and frame, the least and the most, above 0 and up to "
            f"10,000, got {light!r}"
        )
    return np.array([least]) if least == most else np.geomspace(least, most, _LEVELS)


def _binomial(bits: int, chance: float) -> tuple[Array, Array]:
    """The counts that may come, and their probabilities."""
    from scipy.special import gammaln, xlog1py, xlogy

    mean, spread = bits * chance, np.sqrt(bits * chance * (1 - chance))
    reach = _SIGMAS * spread + 2 * _SIGMAS
    # Where the spread is many counts, every so many-th of them gives the same sums: of smooth
    # functions with a bell's weights they agree to far beyond ten digits.
    step = max(1, int(spread / _PER_SIGMA))
    counts = np.arange(max(0, int(mean - reach)), min(bits, int(mean + reach) + 1) + 1.0, step)
    logarithms = xlogy(counts, chance) + xlog1py(bits - counts, -chance)
    logarithms -= gammaln(counts + 1) + gammaln(bits - counts + 1)
    weights = np.exp(logarithms - logarithms.max())
    return counts, weights / weights.sum()


def _decibel(ratio: npt.ArrayLike) -> Array:
    return np.asarray(20 * np.log10(np.asarray(ratio, np.float64)))
