"""The information of each pixel about its intensity, at the light of its neighborhood."""

import numpy as np

from jotlight.interrupts import interruptible
from jotlight.sensing.likelihood import Likelihood
from jotlight.sensing.problem import Problem
from jotlight.sensing.response import Array, inverse_detection_probability
from jotlight.sensing.stacks import each_image, image_sums

_BLUR = 2.0
"""The standard deviation, in pixels, of the Gaussian for the local fraction of ones."""

_MIN_INFORMATION = 4.0
"""Bits count fully if they say at least 1/4 of what bits of the typical jot say. With 1 in place
of 1/4, images in dim light with uneven dark counts lose 0.4 to 0.8 dB."""

_TABLE_SIZE = 1025
"""The number of points in the table from the odds of a 1 to the information of a bit."""


def local_information(problem: Problem, light_of_ones: Array, constant: Array) -> Array:
    """Return the Fisher information I of each pixel about its intensity, at its local light.

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
    ndarray of float64
        I in units of 1 / intensity², of the shape of the image or of the stack.

    Examples
    --------
    >>> from jotlight.sensing.operators import scaling
    >>> problem = Problem(scaling((4, 4), 1.0), Likelihood(np.full((4, 4), 8), trials=16))
    >>> light = np.ones((4, 4))
    >>> local_information(problem, light, light).round(3)[0, 0]  # 16 / (e^s - 1), s = log 2
    np.float64(16.0)
    """
    from scipy.ndimage import gaussian_filter

    stack = problem.stacked()
    operator, likelihood = stack.operator, stack.likelihood
    trials = np.broadcast_to(np.asarray(likelihood.trials, np.float64), likelihood.shape)
    share = _shares(likelihood, trials, constant)
    counted, trials = share * likelihood.ones, share * trials
    sigma = (0.0, *[_BLUR] * len(operator.input_shape))
    ones, valid = (
        interruptible(gaussian_filter)(operator.adjoint(array), sigma, mode="reflect")
        for array in (counted, trials)
    )
    total = image_sums(trials)
    overall = each_image(image_sums(counted) / total, ones)
    fraction = np.where(valid > 0, ones / np.where(valid > 0, valid, 1), overall)
    mean_bits = total / fraction[0].size
    information = np.empty(fraction.shape)
    for bits in np.unique(mean_bits):
        same = mean_bits == bits
        information[same] = _information_of_bits(likelihood, bits, np.clip(fraction[same], 0, 1))
    information *= np.mean(likelihood.efficiency * light_of_ones) ** 2
    return information if problem.is_stack else information[0]


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


def _information_of_bits(likelihood: Likelihood, bits: float, fraction: Array) -> Array:
    """Return the information of some bits about their light, at fractions of ones."""
    from scipy.special import expit

    # Its logarithm is a smooth function of the log-odds alone, so a table suffices.
    largest = np.log((bits + 3 / 8) / (3 / 8))
    nodes = np.linspace(-largest, largest, _TABLE_SIZE)
    rates = inverse_detection_probability(likelihood.threshold, expit(nodes), expit(-nodes))
    none = np.zeros(_TABLE_SIZE, np.int32)
    one_bit = Likelihood(none, 1, threshold=likelihood.threshold, threads=likelihood.threads)
    table = np.log(one_bit.information(rates))
    odds = (bits * fraction + 3 / 8) / (bits * (1 - fraction) + 3 / 8)
    return np.asarray(bits * np.exp(np.interp(np.log(odds), nodes, table)))
