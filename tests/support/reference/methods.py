"""Slow NumPy twins of the closed-form methods, written directly from the equations."""

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import gammainc, gammaincc, gammaincinv, xlogy
from scipy.stats import binom


def mle(counts, trials, *, threshold=1, sensitivity=1.0, dark=0.0, max_intensity=1.0):
    """Equation (5), where `sensitivity` is the detected light at intensity 1."""
    rate = gammaincinv(threshold, np.asarray(counts) / trials)
    return np.clip((rate - dark) / sensitivity, 0, max_intensity)


def log_likelihood(intensity, ones, frames, dark, *, threshold=1, sensitivity=1.0):
    """Equation (4) for the jots of one pixel."""
    rate = sensitivity * intensity + dark
    one, zero = gammainc(threshold, rate), gammaincc(threshold, rate)
    return np.sum(xlogy(ones, one) + xlogy(frames - ones, zero))


def maximum_likelihood_intensity(
    ones, frames, dark, *, threshold=1, sensitivity=1.0, max_intensity=1.0
):
    """The maximum of equation (4) for the jots of one pixel, by search over a grid."""

    def cost(intensity):
        return -log_likelihood(
            intensity, ones, frames, dark, threshold=threshold, sensitivity=sensitivity
        )

    grid = np.linspace(0, max_intensity, 401)
    best = np.argmin([cost(intensity) for intensity in grid])
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, 400)]
    refined = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-10}).x
    return min((refined, *bounds), key=cost)


def anscombe(count, bits):
    """Equation (6)."""
    return np.sqrt(bits + 1 / 2) * np.arcsin(np.sqrt((count + 3 / 8) / (bits + 3 / 4)))


def algebraic_inverse(z, bits):
    """Equation (7)."""
    return (bits + 3 / 4) * np.sin(z / np.sqrt(bits + 1 / 2)) ** 2 - 3 / 8


def stabilized_moments(probability, bits):
    """The mean and the variance of T(L), L ~ Binomial(K, p)."""
    counts = np.arange(bits + 1)
    weights, z = binom.pmf(counts, bits, probability), anscombe(counts, bits)
    mean = weights @ z
    return mean, weights @ (z - mean) ** 2


def exact_inverse(z, bits):
    """K p at the p with E[T(L)] = z, L ~ Binomial(K, p)."""
    if z <= anscombe(0, bits):
        return 0.0
    if z >= anscombe(bits, bits):
        return float(bits)
    return bits * brentq(lambda p: stabilized_moments(p, bits)[0] - z, 0, 1, xtol=1e-13)


def diffuse(values, is_known):
    """Whole numbers from 0 with about the same sum along each row, column by column."""
    whole = np.zeros(values.shape)
    error = np.arange(len(values)) * 0.6180339887498949 % 1
    for column in range(values.shape[1]):
        wanted = values[:, column] + error
        whole[:, column] = np.where(is_known[:, column], np.maximum(np.floor(wanted), 0), 0)
        error = np.clip(wanted - whole[:, column], -1, 1)
    return whole
