"""The generalized Anscombe transform of readings of several bits, and its exact inverse.

After :func:`generalized_anscombe` the noise of the sum of the readings of a pixel is close to
normal with standard deviation 1/2 (:data:`jotlight.estimators.vst.NOISE`), as long as few readings
are the largest one. Any denoiser for white Gaussian noise then applies.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.estimators import vst
from jotlight.sensing.likelihood.joint_likelihood import JointLikelihood
from jotlight.sensing.likelihood.multibit import ReadingLikelihood
from jotlight.sensing.likelihood.reference import saturation_intensity
from jotlight.underflow import underflows_to_0

_GRID = 1025
"""Number of rates at which the mean of the transform is computed. Others are interpolated."""

_MAX_EXACT_TOTAL = 4096
"""Maximum total of the readings of a pixel whose distribution is computed."""

_NODES = 41
"""Number of nodes of the Gauss-Hermite quadrature for larger totals."""

_LARGEST_SHARE = 0.15
"""Share of the largest readings from which counts near averages are better than the transform."""

Denoise = Callable[[npt.NDArray[np.float32]], npt.NDArray[np.float32]]
"""A denoiser of images (N, H, W)."""


def generalized_anscombe(
    total: npt.ArrayLike, trials: float, read_noise: float
) -> npt.NDArray[np.float32]:
    """Return √(X + 3/8 + n σ²), where X is the sum of n readings.

    Parameters
    ----------
    total : array_like of float
        X, 0 or more.
    trials : float
        n: the number of readings of a pixel.
    read_noise : float
        σ: the standard deviation of the noise of a reading, in photons.

    Returns
    -------
    ndarray of float32
        The transform, of the same shape.

    Notes
    -----
    Starck, Murtagh, and Bijaoui (1998), half of their formula, so that the noise is 1/2 as in
    :func:`jotlight.estimators.vst.anscombe`.

    Examples
    --------
    >>> generalized_anscombe([0, 10], 4, 0.3).round(3)
    array([0.857, 3.276], dtype=float32)
    """
    sums = np.asarray(total, np.float64)
    return np.asarray(np.sqrt(sums + 0.375 + trials * read_noise**2), np.float32)


@underflows_to_0
def transformed_mean(cells: ReadingLikelihood, trials: int, rates: Array) -> Array:
    """Return the expectation of the transform of the sum of some readings at each rate.

    For totals of up to 4096, it is exact: the sum over the distribution of the total. Larger totals
    are taken as normal, with their exact mean and variance.

    Examples
    --------
    >>> from jotlight.sensing.parameters.response import JotResponse
    >>> cells = ReadingLikelihood(JotResponse(3, 0.0, 1), np.zeros((1, 0), np.int32), False)
    >>> transformed_mean(cells, 1, np.array([0.0])).round(4)  # √(3/8)
    array([0.6124])
    """
    highest, noise, _ = cells.response
    length = trials * highest + 1
    if length <= _MAX_EXACT_TOTAL + 1:
        spectrum = np.fft.rfft(cells.distribution(rates), length, axis=1) ** trials
        probabilities = np.fft.irfft(spectrum, length, axis=1)
        return np.asarray(probabilities @ generalized_anscombe(np.arange(length), trials, noise))
    mean, variance, _ = cells.moments(rates)
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    totals = trials * mean[:, None] + np.sqrt(trials * variance)[:, None] * nodes
    values = generalized_anscombe(np.clip(totals, 0, trials * highest), trials, noise)
    return np.asarray(values @ weights / weights.sum())


def denoise_readings(
    joint: JointLikelihood, denoise: Denoise, inverse: str, threads: int | None
) -> Image:
    """Return the estimate (H, W) of the non-iterative method for readings of several bits or noise.

    Parameters
    ----------
    joint : JointLikelihood
        The likelihood of the readings, which have one gain.
    denoise : callable
        The denoiser.
    inverse : {"exact", "algebraic"}
        See :func:`jotlight.estimators.vst.inverse_anscombe`.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Raises
    ------
    ValueError
        When the pixels differ in their readings, efficiency, or dark counts.

    Notes
    -----
    The exact inverse maps the expectation of the transform, with read noise, rounding, and clipping
    at the largest reading, back to the rate (Makitalo and Foi 2013). Bits with read noise have the
    transform of bits, and the probability of a one is mapped back to the rate.
    """
    if not joint.uniform:
        raise ValueError(
            "sensor: expected pixels that are alike, but the mask, the efficiency, or the dark "
            "counts differ"
        )
    trials, term = int(joint.trials.flat[0]), joint.terms[0]
    rate = _rate_of_totals(joint, joint.total[None], trials, denoise, inverse, threads)[0]
    light = (rate - term.cells.dark_counts) / term.cells.efficiency
    found = np.clip(light / term.light, 0, joint.sensor.max_intensity)
    return np.asarray(found, np.float32)


def is_saturated(joint: JointLikelihood) -> bool:
    """Return whether the largest readings are too frequent for the transform, which is biased then.

    A denoiser averages totals, and where most readings are the largest one, those of a brighter
    pixel can hardly make up for those of a darker one.

    Examples
    --------
    >>> from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
    >>> sensor = jl.Sensor(bit_depth=2)
    >>> for readings in ([3, 1, 3, 3], [3, 0, 0, 1, 1, 2, 0]):
    ...     is_saturated(joint_likelihood(jl.Readings([[readings]], sensor), sensor, None))
    True
    False
    """
    cells = joint.terms[0].cells
    if joint.sensor.bit_depth == 1 or not isinstance(cells, ReadingLikelihood):
        return False
    return cells.largest_share >= _LARGEST_SHARE


def _rate_of_totals(
    joint: JointLikelihood,
    total: Array,
    trials: int,
    denoise: Denoise,
    inverse: str,
    threads: int | None,
) -> Array:
    """Return the rates of denoised totals (N, H, W)."""
    term, sensor = joint.terms[0], joint.sensor
    cells = term.cells
    assert isinstance(cells, ReadingLikelihood)
    plain = ReadingLikelihood(cells.response, cells.sample[:1], cells.is_histogram)
    brightest = float(np.max(term.light * sensor.max_intensity + cells.dark_counts))
    saturated = saturation_intensity(sensor) * term.light + float(np.max(cells.dark_counts))
    rates = np.linspace(0, np.sqrt(min(brightest, saturated)), _GRID) ** 2
    if sensor.bit_depth == 1:
        z = denoise(vst.anscombe(total, trials, threads=threads))
        mean = vst.inverse_anscombe(z, trials, inverse=inverse, threads=threads) / trials
        return np.interp(mean, plain.moments(rates)[0], rates)
    z = denoise(generalized_anscombe(total, trials, sensor.read_noise))
    if inverse == "algebraic":
        variance = sensor.read_noise**2
        return np.maximum((z.astype(np.float64) ** 2 - 0.375) / trials - variance, 0)
    return np.interp(z, transformed_mean(plain, trials, rates), rates)
