"""The image of counts that were merged onto a grid of half pixels.

Each reading integrates over 2 x 2 pixels of this grid. The image maximizes the likelihood of the
readings, with a K-conditioned network as prior: half-quadratic splitting, as in K. Zhang et al.,
"Plug-and-Play Image Restoration With Deep Denoiser Prior", IEEE TPAMI 44 (2022), equations (6) to
(8), with the binomial likelihood in place of the Gaussian one. Two steps alternate:

    x = argmin ½(x - x_z)ᵀBᵀWB(x - x_z) - uᵀB(x - x_z) + ½(x - z)ᵀR(x - z)
    z = network(x), for K trials per pixel

B averages 2 x 2 pixels; u and W are the derivative and the information of the log-likelihood about
the light of each square, at the last estimate. R = ¼ K I(z) for the information I of one reading.
For information D I of the squares, and an eigenvalue b² of BᵀB, the noise of x then has the
variance D b²/(D b² + K/4)²/I. It is at most 1/(K I), as the network expects.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.estimators.trial_levels import LocalTrials, local_trials
from jotlight.networks.inference.coarse_scales import sum_counts
from jotlight.networks.inference.engine_backed import EngineBacked
from jotlight.networks.inference.trials_map import denoise_fractions
from jotlight.sensing.likelihood.reference import Jot, reference_jot
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.binomial import arcsin_root
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    intensity_at_probability,
    silence_probability,
)
from jotlight.sensing.sensor import Sensor

_STEPS = 8
"""Number of steps."""

_FIRST, _LAST = 1.0, 4.0
"""K of the first and of the last step, in units of the trials of a pixel."""

_PRIOR = 0.25
"""R in units of K I."""

_CONJUGATE_STEPS = 6
"""Number of steps of the method of conjugate gradients. The condition number is about 5."""

_MIN_RATE = 1e-4
"""Smallest number of detections of the median jot in a frame."""

_MIN_TRIALS = 0.25
"""Smallest number of trials of a pixel for the network."""

_SPREAD, _USUAL = 2.5, 0.005
"""Standard deviation of the window, in pixels, in which the fine image is compared with the
enlarged one; and the mean square of their difference in scenes without fine detail, in units of the
variance 1/(4K) of arcsin √p."""


@dataclasses.dataclass(frozen=True)
class Squares:
    """The readings of squares of 2 x 2 pixels.

    Parameters
    ----------
    ones, trials : ndarray of float64, shape (H, W)
        Numbers of ones and of readings of the square that begins at each pixel.
    efficiency, dark_counts : float or ndarray of shape (H, W)
        η and d of these readings.
    threshold : int
        q.
    """

    ones: Array
    trials: Array
    efficiency: float | Array
    dark_counts: float | Array
    threshold: int

    @classmethod
    def of(cls, merged: Merged) -> "Squares":
        """Return the readings of gray merged counts on a grid of half pixels."""
        trials = np.broadcast_to(np.asarray(merged.trials, np.float64), merged.shape)
        ones = merged.ones.astype(np.float64)
        return cls(ones, trials, merged.efficiency, merged.dark_counts, merged.sensor.threshold)

    def derivatives(self, light: Array) -> tuple[Array, Array]:
        """Return u and W: the derivative of the log-likelihood, and the information.

        Parameters
        ----------
        light : ndarray, shape (H, W)
            The mean light of each square, in photons per jot and frame.
        """
        rate = np.maximum(self.efficiency * light + self.dark_counts, _MIN_RATE)
        p, silence = (
            each(self.threshold, rate) for each in (detection_probability, silence_probability)
        )
        slope = self.efficiency * detection_density(self.threshold, rate)
        scale = slope / np.maximum(p * silence, 1e-12)
        return (self.ones - self.trials * p) * scale, self.trials * slope * scale


def average_squares(image: Array) -> Array:
    """Return B x: the mean of the 2 x 2 pixels from each pixel on. The border is repeated.

    Examples
    --------
    >>> average_squares(np.array([[0.0, 4.0], [8.0, 4.0]])).tolist()
    [[4.0, 4.0], [6.0, 4.0]]
    """
    padded = np.pad(image, ((0, 1), (0, 1)), mode="edge")
    rows = padded[:-1] + padded[1:]
    return np.asarray(0.25 * (rows[:, :-1] + rows[:, 1:]))


def spread_squares(values: Array) -> Array:
    """Return Bᵀ y, the adjoint of :func:`average_squares`."""
    height, width = values.shape
    columns = np.zeros((height, width + 1))
    columns[:, :-1] = values
    columns[:, 1:] += values
    columns[:, -2] += columns[:, -1]
    rows = np.zeros((height + 1, width))
    rows[:-1] = columns[:, :-1]
    rows[1:] += columns[:, :-1]
    rows[-2] += rows[-1]
    return np.asarray(0.25 * rows[:-1])


def fit_light(squares: Squares, light: Array, precision: Array) -> Array:
    """Return the light x of the first step, from an estimate z and the diagonal of R."""
    score, information = squares.derivatives(average_squares(light))

    def apply(step: Array) -> Array:
        return spread_squares(information * average_squares(step)) + precision * step

    # The unknown is x - z, so the term of R has no part in the right side.
    residual = spread_squares(score)
    step = np.zeros_like(light)
    scale = 1 / (0.25 * information + precision)
    scaled = scale * residual
    direction, product = scaled, float((residual * scaled).sum())
    for _ in range(_CONJUGATE_STEPS):
        if product <= 0:
            break
        moved = apply(direction)
        length = product / float((direction * moved).sum())
        step += length * direction
        residual = residual - length * moved
        scaled = scale * residual
        product, last = float((residual * scaled).sum()), product
        direction = scaled + product / last * direction
    return light + step


@dataclasses.dataclass(frozen=True)
class Prior:
    """A K-conditioned network as the prior of the light.

    Parameters
    ----------
    network : EngineBacked
        The network.
    sensor : Sensor
        The sensor.
    of_zeros : bool
        Whether the network estimates the probability of a zero, for bright sensors.
    threads : int, optional
        The number of threads.
    """

    network: EngineBacked
    sensor: Sensor
    of_zeros: bool
    threads: int | None

    @property
    def jot(self) -> Jot:
        """Efficiency and dark counts of the median jot."""
        return reference_jot(self.sensor)

    def rate(self, light: Array) -> Array:
        """Return the expected detections of the median jot."""
        efficiency, dark_counts = self.jot
        return np.maximum(efficiency * light + dark_counts, _MIN_RATE)

    def denoise(self, light: Array, trials: LocalTrials, turns: tuple[int, ...]) -> Array:
        """Return the light without its noise: the mean over some rotations by 90 degrees."""
        of_one = detection_probability, silence_probability
        known = of_one[self.of_zeros](self.sensor.threshold, self.rate(light)).astype(np.float32)
        mean = np.zeros(light.shape)
        for turn in turns:
            own = trials
            if isinstance(trials, np.ndarray):
                own = np.ascontiguousarray(np.rot90(trials, turn))
            turned = np.ascontiguousarray(np.rot90(known, turn))[None]
            denoised = self._denoise(turned, own)
            mean += np.rot90(denoised, -turn) / np.float64(len(turns))
        efficiency, dark_counts = self.jot
        p, zero = (1 - mean, mean) if self.of_zeros else (mean, 1 - mean)
        limits = detection_probability(self.sensor.threshold, _MIN_RATE), 1e-6
        p, zero = np.maximum(p, limits[0]), np.maximum(zero, limits[1])
        return intensity_at_probability(self.sensor.threshold, p, zero, efficiency, dark_counts)

    def _denoise(self, fractions: Image, trials: LocalTrials) -> Image:
        zeros, threads = self.of_zeros, self.threads
        images = denoise_fractions(self.network, fractions, [trials], zeros=zeros, threads=threads)
        return images[0]

    def information(self, light: Array) -> Array:
        """Return the information of one reading of the median jot about the light."""
        one = np.ones(light.shape)
        return Squares(0 * one, one, *self.jot, self.sensor.threshold).derivatives(light)[1]

    def angle(self, light: Array) -> Array:
        """Return arcsin √p, whose noise is the same everywhere."""
        p = detection_probability(self.sensor.threshold, self.rate(light))
        return arcsin_root(p)


def estimate_light(squares: Squares, prior: Prior, enlarged: Array) -> Array:
    """Return the light of each pixel of the fine grid, in photons per jot and frame.

    Parameters
    ----------
    squares : Squares
        The readings.
    prior : Prior
        The network.
    enlarged : ndarray, shape (H, W)
        The light of the coarse image, enlarged: the first estimate.
    """
    trials = np.maximum(spread_squares(squares.trials), _MIN_TRIALS)
    local, light = local_trials(trials, prior.threads), enlarged
    for step, factor in enumerate(np.geomspace(_FIRST, _LAST, _STEPS)):
        k = np.asarray(np.maximum(factor * local, 1), np.float32)
        precision = _PRIOR * k * prior.information(light)
        noisy = fit_light(squares, light, precision)
        is_last = step == _STEPS - 1
        turns = tuple(range(4)) if is_last else (step % 4,)
        light = prior.denoise(noisy, k if k.ndim else max(1, round(float(k))), turns)
    return _without_noise(light, enlarged, trials, prior)


def _without_noise(light: Array, enlarged: Array, trials: Array, prior: Prior) -> Array:
    """Return the fine image, but the enlarged one where both differ by noise alone.

    The difference is shrunk as by James and Stein, in proportion to its excess over its usual mean
    square. So scenes without fine detail get no fine noise.
    """
    from scipy.ndimage import gaussian_filter

    difference = prior.angle(light) - prior.angle(enlarged)
    energy = gaussian_filter(difference**2, _SPREAD)
    usual = _USUAL / (4 * trials)
    share = np.maximum(0, 1 - usual / np.maximum(energy, 1e-30))
    return np.asarray(enlarged + share * (light - enlarged))


def enlarge(image: npt.NDArray[np.floating]) -> Array:
    """Return an image on a grid of half pixels, (2 H, 2 W), by cubic interpolation.

    Pixel i of the image is the mean of the squares that begin at the pixels 2 i and 2 i + 1, so its
    center is that of the pixel 2 i + 1.

    Examples
    --------
    >>> enlarge(np.full((3, 4), 0.5)).shape
    (6, 8)
    """
    from scipy.ndimage import map_coordinates

    places = np.meshgrid(*[(np.arange(2 * n) - 1) / 2 for n in image.shape], indexing="ij")
    return np.asarray(map_coordinates(image.astype(np.float64), places, order=3, mode="nearest"))


def coarse_counts(merged: Merged) -> Merged:
    """Return the counts of a grid of half pixels, summed over 2 x 2 squares, as those of pixels."""
    jots = merged.efficiency, merged.dark_counts
    return sum_counts(merged.ones, merged.trials, *jots, merged.sensor)
