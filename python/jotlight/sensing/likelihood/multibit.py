"""Readings of several bits, and read noise: their probabilities and their likelihood."""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.kept import kept_property
from jotlight.sensing.bits.values import as_doubles, flatten
from jotlight.sensing.parameters.response import JotResponse
from jotlight.underflow import underflows_to_0


@underflows_to_0
def reading_probability(
    reading: npt.ArrayLike,
    rate: npt.ArrayLike,
    *,
    bit_depth: int = 1,
    read_noise: float = 0.0,
    threshold: int = 1,
    threads: int | None = None,
) -> Array:
    """Return P(R = r), the probability that a jot at rate s reports r.

    Parameters
    ----------
    reading : array_like of int
        r, 0 to 2^b - 1.
    rate : array_like of float
        s: the expected detections per frame, 0 or more.
    bit_depth : int
        b: the bits of a reading.
    read_noise : float
        σ: the standard deviation of the read noise, in photons.
    threshold : int
        q, for readings of one bit.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float64
        Probabilities, of the common shape of readings and rates.

    Raises
    ------
    ValueError
        When a number is out of range.

    Notes
    -----
    It is Σ P(Y = y) P(clip(round(y + σ N), 0, 2^b - 1) = r) over the numbers of photons y, where Y
    has a Poisson distribution and N a standard normal one. The relative error is below 1e-10.

    Examples
    --------
    >>> reading_probability([0, 1, 2, 3], 1.0, bit_depth=2).round(4).tolist()
    [0.3679, 0.3679, 0.1839, 0.0803]
    >>> reading_probability([0, 1], 0.0, read_noise=0.3).round(4).tolist()  # 1 - Φ(0.5 / 0.3)
    [0.9522, 0.0478]
    """
    highest = 2**bit_depth - 1
    readings, rates = np.broadcast_arrays(np.asarray(reading), np.asarray(rate, np.float64))
    if readings.dtype.kind not in "iu" or not ((readings >= 0) & (readings <= highest)).all():
        raise ValueError(f"reading: expected whole numbers from 0 to {highest}, got {reading!r}")
    if not (rates >= 0).all():
        raise ValueError(f"rate: expected numbers of 0 or more, got {rate!r}")
    flat = np.ascontiguousarray(readings.reshape(-1), np.int32)
    out = np.empty(flat.size)
    response = highest, float(read_noise), threshold
    engine.readings_log_probability(
        response, flat, np.ascontiguousarray(rates.reshape(-1)), out, threads
    )
    return np.asarray(np.exp(out).reshape(readings.shape))


def reading_distribution(
    response: JotResponse, rate: Array, length: int, threads: int | None = None
) -> Array:
    """Return the probabilities of the readings 0 to `length` - 1 at each rate, (n, length).

    Readings above the largest one have probability 0. The absolute errors are below 1e-13. This is
    much faster than :func:`reading_probability`, whose relative errors are small, too.

    Examples
    --------
    >>> reading_distribution(JotResponse(3, 0.0, 1), np.ones(1), 5).round(4).tolist()
    [[0.3679, 0.3679, 0.1839, 0.0803, 0.0]]
    """
    out = np.empty((rate.size, length))
    engine.readings_distribution(response, np.ascontiguousarray(rate), out, threads)
    return out


@dataclasses.dataclass(frozen=True, eq=False)
class ReadingLikelihood:
    """The log-likelihood of readings of several bits, a function of the light s of each cell.

    A cell is a jot, or a pixel whose jots all receive the same light. The log-likelihood is the sum
    of log P(R = r) over the readings of a cell, at the rate η s + d. It is concave.

    Examples
    --------
    >>> cells = ReadingLikelihood(JotResponse(3, 0.0, 1), np.array([[2, 0, 1, 0]], np.int32), True)
    >>> gradient, curvature = cells.gradient_and_curvature(np.array([2 / 3]))  # 0, 0, and 2
    >>> gradient.round(4).tolist(), curvature.round(4).tolist()
    ([0.0], [4.5])
    """

    response: JotResponse
    sample: npt.NDArray[np.int32]
    """How often each reading occurs (..., number), or the readings (..., number); -1 is none."""
    is_histogram: bool
    efficiency: float | Array = 1.0
    dark_counts: float | Array = 0.0
    threads: int | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the cells."""
        return self.sample.shape[:-1]

    @kept_property
    def trials(self) -> Array:
        """The number of readings of each cell."""
        valid = self.sample if self.is_histogram else self.sample >= 0
        return np.asarray(valid.sum(axis=-1, dtype=np.float64))

    @kept_property
    def total(self) -> Array:
        """The sum of the readings of each cell."""
        if self.is_histogram:
            levels = np.arange(self.sample.shape[-1], dtype=np.float64)
            return np.asarray(self.sample @ levels)
        return np.asarray(np.maximum(self.sample, 0).sum(axis=-1, dtype=np.float64))

    @property
    def max_reading(self) -> int:
        """2^b - 1."""
        return self.response.max_reading

    @property
    def largest_share(self) -> float:
        """The fraction of the readings that are the largest one."""
        largest = self.sample[..., -1] if self.is_histogram else self.sample == self.max_reading
        return float(largest.sum(dtype=np.float64) / max(self.trials.sum(), 1))

    def value(self, light: npt.ArrayLike) -> float:
        """Return the log-likelihood in nats, summed over all cells."""
        return engine.readings_log_likelihood(
            self.response, self._cells(), self._light(light), self.threads
        )

    def gradient_and_curvature(self, light: npt.ArrayLike) -> tuple[Array, Array]:
        """Return the first derivative of each cell and minus the second one, about its light."""
        flat = self._light(light)
        gradient, curvature = np.empty(flat.size), np.empty(flat.size)
        engine.readings_gradient_and_curvature(
            self.response, self._cells(), flat, gradient, curvature, self.threads
        )
        return gradient.reshape(self.shape), curvature.reshape(self.shape)

    def information(self, light: npt.ArrayLike) -> Array:
        """Return the Fisher information of the readings of each cell about its light."""
        return np.asarray(self.trials * self.information_per_reading(light))

    def information_per_reading(self, light: npt.ArrayLike) -> Array:
        """Return the Fisher information of one reading of each cell about its light.

        It is accurate to nine digits.
        """
        rates = self._rate(light)
        information = np.empty(rates.size)
        engine.readings_information(self.response, rates.reshape(-1), information, self.threads)
        return np.asarray(np.square(self.efficiency) * information.reshape(rates.shape))

    def moments(self, light: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Return the mean and the variance of a reading, and the derivative of the mean.

        The derivative is that about the light. Where cells are alike, any shape is allowed.
        """
        rates = self._rate(light)
        moments = np.empty((rates.size, 3))
        engine.readings_moments(self.response, rates.reshape(-1), moments, self.threads)
        mean, variance, slope = moments.T.reshape(3, *rates.shape)
        return mean, variance, np.asarray(self.efficiency * slope)

    def distribution(self, light: Array) -> Array:
        """Return the probabilities of all readings at each light, if cells are alike, (n, 2^b)."""
        return reading_distribution(
            self.response, self._rate(light), self.max_reading + 1, self.threads
        )

    def probability(self, reading: npt.ArrayLike, light: Array) -> Array:
        """Return the probability of a reading at each light, if cells are alike."""
        highest, noise, threshold = self.response
        return reading_probability(
            reading,
            self._rate(light),
            bit_depth=(highest + 1).bit_length() - 1,
            read_noise=noise,
            threshold=threshold,
            threads=self.threads,
        )

    def likely_rate(self) -> Array:
        """Return the rate of the mean reading of each cell: the maximum in closed form.

        It is exact without read noise for readings of several bits, none of which is the largest.
        Otherwise it is near the maximum.
        """
        highest, _, threshold = self.response
        number = np.maximum(self.trials, 1)
        mean = self.total / number
        if highest == 1:
            # Half a one and half a zero keep the rate finite.
            mean = np.clip(mean, 0.5 / number, 1 - 0.5 / number)
            return np.asarray(threshold - 1 - np.log1p(-mean))
        nearly_all = np.maximum(highest - mean, 0.1) < 1
        return np.asarray(np.where(nearly_all, mean + np.sqrt(mean), mean))

    def engine_argument(self) -> tuple[JotResponse, Any, int]:
        """Return the cells as the engine's functions of joint likelihoods expect them."""
        return self.response, self._cells(), int(np.prod(self.shape, dtype=int))

    def _rate(self, light: npt.ArrayLike) -> Array:
        rates = self.efficiency * np.asarray(light, np.float64) + self.dark_counts
        return np.ascontiguousarray(rates)

    def _light(self, light: npt.ArrayLike) -> Array:
        return as_doubles(np.broadcast_to(np.asarray(light, np.float64), self.shape)).reshape(-1)

    def _cells(self) -> tuple[bool, npt.NDArray[np.int32], Any, Any]:
        sample = np.ascontiguousarray(self.sample).reshape(-1)
        return self.is_histogram, sample, flatten(self.efficiency), flatten(self.dark_counts)
