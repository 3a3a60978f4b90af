"""Slow NumPy twins of the networks; random networks and bits as test data."""

import dataclasses

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import convolve

import jotlight as jl

_ALL = 1e15
"""A largest intensity that no output reaches."""


def last_layer(network, data, sensor=None, *, threads=None):
    """Return the output of the last layer, which an estimate clips to [0, S].

    It is the difference of the estimates by the network and by one with the opposite output.
    """
    own = network.sensor.replace(max_intensity=_ALL)
    sensor = (sensor or network.sensor).replace(max_intensity=_ALL)
    *layers, last = network.layers
    if last.coefficients is None:
        opposite = dataclasses.replace(last, filters=-last.filters)
        if last.skip is not None:
            raise NotImplementedError("a skip connection into a last layer without splines")
    else:
        opposite = dataclasses.replace(last, coefficients=-last.coefficients)
    if isinstance(data, jl.Bits):
        data = jl.Bits(data.packed, width=data.width, sensor=sensor)
    above, below = (
        jl.Network([*layers, each], own).reconstruct(data, sensor, threads=threads)
        for each in (last, opposite)
    )
    return above - below


def random_layer(rng, filters, *, low=-2.0, high=3.0, number=11):
    taps = rng.normal(0, 1, filters) / np.sqrt(np.prod(filters[1:]))
    coefficients = rng.normal(0, 1, (filters[0], number))
    return jl.Layer(taps, coefficients, low, (high - low) / (number - 3))


def random_network(rng, sensor, channels, sizes, *, tied):
    """One size of filter for each layer after the first; `channels` is one longer than `sizes`."""
    block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)
    first = random_layer(rng, (channels[0], *block))
    if tied:
        taps = rng.normal(0, 2 / sensor.trials, first.filters.shape)
        first = jl.Layer(taps, first.coefficients, first.start, first.spacing)
    rest = [
        random_layer(rng, (outputs, inputs, *size))
        for inputs, outputs, size in zip(channels, channels[1:], sizes, strict=False)
    ]
    return jl.Network([first, *rest], sensor)


def random_bits(rng, sensor, height, width):
    side = sensor.oversampling
    return rng.random((sensor.frames, height * side, width * side)) < 0.4


def spline(z, coefficients, start, spacing):
    """Equations (8) and (10), constant outside of the knots."""
    number = len(coefficients)
    knots = start + spacing * (np.arange(number + 4) - 3)
    curve = BSpline(knots, coefficients, 3)
    return curve(np.clip(z, knots[3], knots[number]))


def block_sums(filters, bits, side, dead=None):
    """Equation (11), with each dead jot replaced by the mean of the live jots of its pixel."""
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
    """The estimate from the sums of the first layer: equations (10), (9), (8), and so on."""
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
    (estimate,) = planes
    return estimate
