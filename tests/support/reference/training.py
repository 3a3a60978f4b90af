"""Slow twins of training, in float64."""

from itertools import pairwise, product
from types import SimpleNamespace

import numpy as np
from scipy.integrate import quad
from scipy.ndimage import convolve
from scipy.optimize import minimize
from scipy.special import comb

from reference import networks


def layers_of(network, vector):
    """The filters and coefficients of each layer from the vector of all parameters."""
    layers, start = [], 0
    for layer in network.layers:
        parts = []
        for shape in (layer.filters.shape, layer.coefficients.shape):
            size = int(np.prod(shape))
            parts.append(np.array(vector[start : start + size]).reshape(shape))
            start += size
        layers.append(SimpleNamespace(filters=parts[0], coefficients=parts[1],
                                      start=layer.start, spacing=layer.spacing))  # fmt: skip
    assert start == len(vector)
    return layers


def first_sums(filters, bits, side):
    """Equation (11), for tied filters too."""
    frames, height, width = bits.shape
    jots = bits.reshape(frames, height // side, side, width // side, side).astype(float)
    taps = np.broadcast_to(filters, (len(filters), frames, side, side))
    return np.einsum("ctij,thiwj->chw", taps, jots)


def spline_inputs(network, vector, bits):
    """Inputs of the splines of each layer: equations (11), (9), and so on."""
    layers = layers_of(network, vector)
    found = [first_sums(layers[0].filters, bits, network.sensor.oversampling)]
    for before, layer in pairwise(layers):
        planes = [
            networks.spline(plane, coefficients, before.start, before.spacing)
            for plane, coefficients in zip(found[-1], before.coefficients, strict=True)
        ]
        mixed = [
            sum(convolve(x, taps, mode="reflect") for x, taps in zip(planes, filters, strict=True))
            for filters in layer.filters
        ]
        found.append(np.array(mixed))
    return found


def output(network, vector, bits):
    layers = layers_of(network, vector)
    return networks.network(
        layers, first_sums(layers[0].filters, bits, network.sensor.oversampling)
    )


def jacobian(function, vector, step=1e-5):
    """The Jacobian by central differences, one column per parameter."""
    columns = []
    for index in range(len(vector)):
        change = np.zeros(len(vector))
        change[index] = step
        columns.append((function(vector + change) - function(vector - change)).ravel())
    return np.array(columns).T / (2 * step)


def counted_pixels(patch, size, border):
    """A mask of the pixels that count: those outside the border, except at the image's own rim."""
    _, top, bottom, left, right = patch
    rows, columns = np.mgrid[top:bottom, left:right]
    near = (rows < top + border) & (top > 0)
    near |= (rows >= bottom - border) & (bottom < size[0])
    near |= (columns < left + border) & (left > 0)
    near |= (columns >= right - border) & (right < size[1])
    return ~near


def nearest_filter(taps, nu):
    """The nearest taps with sum 1 and ‖x‖₁ ≤ 1 + 2ν, by a search over all signs."""
    whole = taps + (1 - taps.sum()) / len(taps)
    if np.abs(whole).sum() <= 1 + 2 * nu:
        return whole
    best = None
    for signs in product((-1, 0, 1), repeat=len(taps)):
        found = np.zeros(len(taps))
        for sign, total in ((1, 1 + nu), (-1, -nu)):
            kind = np.array(signs) == sign
            if kind.any():
                found[kind] = taps[kind] + (total - taps[kind].sum()) / kind.sum()
        fits = abs(found.sum() - 1) < 1e-9 and np.abs(found).sum() <= 1 + 2 * nu + 1e-9
        if fits and (best is None or np.sum((found - taps) ** 2) < np.sum((best - taps) ** 2)):
            best = found
    return best


def nearest_weights(taps, total):
    """The nearest taps with x ≥ 0 and Σ x = total, by a search over all supports."""
    best = None
    for kept in product((False, True), repeat=len(taps)):
        kind = np.array(kept)
        if not kind.any():
            continue
        found = np.where(kind, taps, 0)
        found[kind] += (total - taps[kind].sum()) / kind.sum()
        far = np.sum((found - taps) ** 2)
        if found.min() >= 0 and (best is None or far < np.sum((best - taps) ** 2)):
            best = found
    return best


def nearest_monotone(values, low, high):
    """The nearest monotone values in [low, high], by quadratic programming."""
    steps = [
        {"type": "ineq", "fun": lambda x, k=k: x[k + 1] - x[k]} for k in range(len(values) - 1)
    ]
    found = minimize(
        lambda x: 0.5 * np.sum((x - values) ** 2),
        np.linspace(low, high, len(values)),
        jac=lambda x: x - values,
        bounds=[(low, high)] * len(values),
        constraints=steps,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return found.x


def posterior(count, bits):
    """Mean and deviation of c given L, for uniform c in [0, 1], α = K, and q = 1, and P(L)."""

    def moment(power):
        def integrand(c):
            return c**power * (1 - np.exp(-c)) ** count * np.exp(-c * (bits - count))

        return quad(integrand, 0, 1, epsabs=0, epsrel=1e-11)[0]

    zeroth, first, second = map(moment, range(3))
    mean = first / zeroth
    return mean, np.sqrt(second / zeroth - mean**2), comb(bits, count) * zeroth
