"""The information of each pixel about its intensity, at the light of its neighborhood."""

import math

import numpy as np

from jotlight.array_types import Array
from jotlight.interrupts import interruptible
from jotlight.sensing.data.stacks import each_image, image_sums
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.likelihood.problem import Problem
from jotlight.sensing.parameters.response import inverse_detection_probability

_MIN_BLUR = 2.0
"""The smallest standard deviation, in pixels, of the Gaussian for the local fraction of ones."""

_MIN_COUNT = 20.0
"""The smallest number of ones that the Gaussian window contains on average, and of zeros. In a
smaller window, a one in a dim scene would be its own neighborhood, which would look bright."""

_PAD = 3 / 8
"""The ones, and the zeros, that are added to those of a window, so that the fraction of ones is
neither 0 nor 1."""

_MIN_INFORMATION = 4.0
"""Bits count fully if they say at least 1/4 of what bits of the typical jot say. With 1 in place
of 1/4, images in dim light with uneven dark counts lose 0.4 to 0.8 dB."""

_TABLE_SIZE = 1025
"""The number of points in the table from the odds of a 1 to the information of a bit."""


def local_information(
    problem: Problem, light_of_ones: Array, constant: Array
) -> tuple[Array, Array]:
    """Return each pixel's Fisher information I about its intensity, at its local light.

    The second result is the squared skewness of the count of the pixel's ones.

    Every pixel is treated as if it had the mean number of valid bits. If jots have different dark
    counts, bits of hot ones count less, because they say less about the light.

    Parameters
    ----------
    problem : Problem
        The data and their operator.
    light_of_ones : ndarray of float64
        The light of the cells at the constant intensity 1, before the efficiency.
    constant : ndarray of float64
        The light of the cells at the most likely constant intensity.

    Returns
    -------
    information : ndarray of float64
        I in units of 1 / intensity², of the shape of the image or of the stack.
    skewness : ndarray of float64
        (1 - 2p)² / (K p (1 - p)) for the local fraction of ones p.

    Examples
    --------
    >>> from jotlight.sensing.likelihood.operators import scaling
    >>> problem = jl.Problem(scaling((4, 4), 1.0), jl.Likelihood(np.full((4, 4), 8), trials=16))
    >>> light = np.ones((4, 4))
    >>> information, skewness = local_information(problem, light, light)
    >>> information.round(3)[0, 0], skewness[0, 0]  # 16 / (e^s - 1), s = log 2
    (np.float64(16.0), np.float64(0.0))
    """
    stack = problem.stacked()
    operator, likelihood = stack.operator, stack.likelihood
    trials = np.broadcast_to(np.asarray(likelihood.trials, np.float64), likelihood.shape)
    share = _shares(likelihood, trials, constant)
    counted, trials = share * likelihood.ones, share * trials
    sums = image_sums(counted), image_sums(trials)
    images = operator.adjoint(counted), operator.adjoint(trials)
    odds = np.stack([_local_odds(*image) for image in zip(*images, *sums, strict=True)])
    mean_bits = sums[1] / odds[0].size
    information = np.empty(odds.shape)
    for bits in np.unique(mean_bits):
        same = mean_bits == bits
        information[same] = _information_of_bits(likelihood, bits, odds[same])
    # (1 - 2p)² / (p (1 - p)) is (1 - odds)² / odds.
    skewness = (1 - odds) ** 2 / (each_image(mean_bits, odds) * odds)
    information *= np.mean(likelihood.efficiency * light_of_ones) ** 2
    return (information, skewness) if problem.is_stack else (information[0], skewness[0])


def _local_odds(counted: Array, trials: Array, all_ones: float, all_bits: float) -> Array:
    """Return the odds of a one in the neighborhood of each pixel of an image."""
    pixels, dimensions = counted.size, counted.ndim
    rare = (min(all_ones, all_bits - all_ones) + _PAD) / pixels
    # A Gaussian has the noise of a uniform window of (4 π σ²)^(dimensions / 2) pixels.
    side = max((_MIN_COUNT / rare) ** (1 / dimensions), math.sqrt(4 * math.pi) * _MIN_BLUR)
    side = min(side, max(counted.shape))
    ones, valid = _blur(np.stack([counted, trials]), side / math.sqrt(4 * math.pi))
    fraction = np.where(valid > 0, ones / np.where(valid > 0, valid, 1), all_ones / all_bits)
    fraction = np.clip(fraction, 0, 1)
    bits, pad = all_bits / pixels, _PAD / min(side**dimensions, pixels)
    return np.asarray((bits * fraction + pad) / (bits * (1 - fraction) + pad))


def _blur(images: Array, sigma: float) -> Array:
    from scipy.ndimage import gaussian_filter

    sigmas = (0.0, *[sigma] * (images.ndim - 1))
    return np.asarray(interruptible(gaussian_filter)(images, sigmas, mode="reflect"))


def _shares(likelihood: Likelihood, trials: Array, constant: Array) -> float | Array:
    """Return which shares of the bits count: 1, or less if they say much less than usual.

    Otherwise equivalent counts of a few hot jots, which have many trials and nearly only ones,
    would hide the light of their neighbors.
    """
    if np.ndim(likelihood.dark_counts) == 0:
        return 1.0
    known = trials > 0
    information = likelihood.information(constant) / np.where(known, trials, 1)
    shares = np.ones(trials.shape)
    for share, each, valid in zip(shares, information, known, strict=True):
        usual = float(np.median(each[valid])) if valid.any() else 0.0
        if usual > 0:
            np.minimum(_MIN_INFORMATION * each / usual, 1.0, out=share)
    return shares


def _information_of_bits(likelihood: Likelihood, bits: float, odds: Array) -> Array:
    """Return the information of some bits about their light, at the odds of a one."""
    from scipy.special import expit

    # Its logarithm is a smooth function of the log-odds alone, so a table suffices. The pad is at
    # least that of a window of the whole image, so no odds are outside the table.
    pad = _PAD / odds[0].size
    largest = np.log((bits + pad) / pad)
    nodes = np.linspace(-largest, largest, _TABLE_SIZE)
    rates = inverse_detection_probability(likelihood.threshold, expit(nodes), expit(-nodes))
    none = np.zeros(_TABLE_SIZE, np.int32)
    one_bit = Likelihood(none, 1, threshold=likelihood.threshold, threads=likelihood.threads)
    table = np.log(one_bit.information(rates))
    return np.asarray(bits * np.exp(np.interp(np.log(odds), nodes, table)))
