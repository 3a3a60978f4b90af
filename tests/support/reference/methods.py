"""Slow and obvious NumPy twins of the methods."""

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import convolve
from scipy.optimize import brentq, minimize_scalar
from scipy.special import gammainc, gammaincc, gammaincinv, xlogy
from scipy.stats import binom


def mle(counts, trials, *, threshold=1, sensitivity=1.0, dark=0.0, most=1.0):
    rate = gammaincinv(threshold, np.asarray(counts) / trials)
    return np.clip((rate - dark) / sensitivity, 0, most)


def log_likelihood(intensity, ones, frames, dark, *, threshold=1, sensitivity=1.0):
    rate = sensitivity * intensity + dark
    fired, stayed_dark = gammainc(threshold, rate), gammaincc(threshold, rate)
    return np.sum(xlogy(ones, fired) + xlogy(frames - ones, stayed_dark))


def most_likely(ones, frames, dark, *, threshold=1, sensitivity=1.0, most=1.0):
    """The intensity of one pixel from the ones of its jots, by looking everywhere."""

    def cost(intensity):
        return -log_likelihood(
            intensity, ones, frames, dark, threshold=threshold, sensitivity=sensitivity
        )

    grid = np.linspace(0, most, 401)
    best = np.argmin([cost(intensity) for intensity in grid])
    near = grid[max(best - 1, 0)], grid[min(best + 1, 400)]
    refined = minimize_scalar(cost, bounds=near, method="bounded", options={"xatol": 1e-10}).x
    return min((refined, *near), key=cost)


def anscombe(count, bits):
    """Equation (6)."""
    return np.sqrt(bits + 1 / 2) * np.arcsin(np.sqrt((count + 3 / 8) / (bits + 3 / 4)))


def algebraic_inverse(z, bits):
    """Equation (7)."""
    return (bits + 3 / 4) * np.sin(z / np.sqrt(bits + 1 / 2)) ** 2 - 3 / 8


def stabilised_moments(probability, bits):
    """Mean and variance of T(L), L ~ Binomial(K, p)."""
    counts = np.arange(bits + 1)
    weights, z = binom.pmf(counts, bits, probability), anscombe(counts, bits)
    mean = weights @ z
    return mean, weights @ (z - mean) ** 2


def exact_inverse(z, bits):
    if z <= anscombe(0, bits):
        return 0.0
    if z >= anscombe(bits, bits):
        return float(bits)
    return bits * brentq(lambda p: stabilised_moments(p, bits)[0] - z, 0, 1, xtol=1e-13)


def spline(z, coefficients, start, spacing):
    """Equations (8) and (10), constant outside of the knots."""
    number = len(coefficients)
    knots = start + spacing * (np.arange(number + 4) - 3)
    curve = BSpline(knots, coefficients, 3)
    return curve(np.clip(z, knots[3], knots[number]))


def block_sums(filters, bits, side, dead=None):
    """Equation (11); a dead jot counts as the mean of the live ones of its pixel."""
    frames, height, width = bits.shape
    live = np.ones((height, width), bool) if dead is None else ~dead
    taps = np.broadcast_to(filters, (len(filters), frames, side, side)).astype(float)
    sums = np.empty((len(filters), height // side, width // side))
    for row, column in np.ndindex(sums.shape[1:]):
        block = np.s_[row * side : (row + 1) * side, column * side : (column + 1) * side]
        seen = bits[:, *block]
        sums[:, row, column] = np.sum(
            taps * np.where(live[block], seen, seen[:, live[block]].mean()), axis=(1, 2, 3)
        )
    return sums


def network(layers, sums):
    """From the sums of the first layer to the picture: equations (10), (9), (8) and on."""
    planes = sums
    for index, layer in enumerate(layers):
        if index:
            planes = [
                sum(
                    convolve(plane, taps.astype(float), mode="reflect")
                    for plane, taps in zip(planes, filters, strict=True)
                )
                for filters in layer.filters
            ]
        planes = [
            spline(plane, coefficients, layer.start, layer.spacing)
            for plane, coefficients in zip(planes, layer.coefficients, strict=True)
        ]
    (picture,) = planes
    return picture
