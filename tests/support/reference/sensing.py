"""Reference implementation of sensing, written like the definitions: paper, section 2.1."""

from itertools import pairwise

import numpy as np
from scipy.integrate import fixed_quad
from scipy.interpolate import BSpline
from scipy.special import gammainc

DEGREES = {"box": 0, "linear": 1, "quadratic": 2, "cubic": 3}


def kernel_taps(degree, oversampling):
    """Return g, the integrals of the B-spline over the jots."""
    spline = BSpline.basis_element(np.arange(degree + 2))
    edges = np.arange((degree + 1) * oversampling + 1) / oversampling
    return np.array([fixed_quad(spline, *jot, n=6)[0] for jot in pairwise(edges)])


def mirrored(index, size):
    while not 0 <= index < size:
        index = -1 - index if index < 0 else 2 * size - 1 - index
    return index


def spread(line, degree, oversampling):
    """Return G c in one dimension: g centered on each pixel, times the pixel's intensity."""
    taps = kernel_taps(degree, oversampling)
    light = np.zeros(len(line) * oversampling)
    for pixel in range(-degree - 1, len(line) + degree + 1):
        first = pixel * oversampling - degree * oversampling // 2
        for jot, tap in enumerate(taps, start=first):
            if 0 <= jot < len(light):
                light[jot] += tap * line[mirrored(pixel, len(line))]
    return light


def rate(sensor, image):
    """Return η s + d with s = (α/T)·(G c) of one channel."""
    light = np.asarray(image, np.float64)
    for axis in (0, 1):
        light = np.apply_along_axis(
            spread, axis, light, DEGREES[sensor.kernel], sensor.oversampling
        )
    return sensor.efficiency * sensor.gain / sensor.frames * light + sensor.dark_counts


def probability(sensor, image):
    """Return P(b = 1) of one channel."""
    p = gammainc(sensor.threshold, rate(sensor, image))
    return p if sensor.mask is None else np.where(sensor.mask, 0, p)


def block_counts(bits, side, mask=None):
    """Return L of bits (T, H, W), without the jots of a mask (H, W)."""
    _, height, width = bits.shape
    counts = np.zeros((height // side, width // side), int)
    for row in range(height):
        for column in range(width):
            if mask is None or not mask[row, column]:
                counts[row // side, column // side] += np.count_nonzero(bits[:, row, column])
    return counts
