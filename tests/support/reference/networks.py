"""Random networks and bits to try them on."""

import numpy as np

import jotlight as jl


def random_layer(rng, filters, *, low=-2.0, high=3.0, number=11):
    taps = rng.normal(0, 1, filters) / np.sqrt(np.prod(filters[1:]))
    coefficients = rng.normal(0, 1, (filters[0], number))
    return jl.Layer(taps, coefficients, low, (high - low) / (number - 3))


def random_network(rng, sensor, channels, sizes, *, tied):
    """One size of filter for each layer after the first; `channels` is one longer than `sizes`."""
    block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)
    first = random_layer(rng, (channels[0], *block))
    if tied:
        taps = rng.normal(0, 2 / sensor.bits_per_pixel, first.filters.shape)
        first = jl.Layer(taps, first.coefficients, first.start, first.spacing)
    rest = [
        random_layer(rng, (outputs, inputs, *size))
        for inputs, outputs, size in zip(channels, channels[1:], sizes, strict=False)
    ]
    return jl.Network([first, *rest], sensor)


def random_bits(rng, sensor, height, width):
    side = sensor.oversampling
    return rng.random((sensor.frames, height * side, width * side)) < 0.4
