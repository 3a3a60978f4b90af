"""Networks with strides, kept planes and more, as the definitions have them, and random ones."""

import dataclasses

import numpy as np
from scipy.interpolate import BSpline

import jotlight as jl
from reference import networks


def filtered(planes, layer):
    """Equation (9) with a stride: past the rim, planes are mirrored."""
    outputs, _, height, width = layer.filters.shape
    row, column = layer.padding
    rows, columns = (size // layer.stride for size in planes.shape[1:])
    wide = np.pad(planes, ((0, 0), (height, height), (width, width)), mode="symmetric")
    found = np.zeros((outputs, rows, columns))
    for y, x in np.ndindex(height, width):
        # What is convolved with filters meets them turned around.
        taps = layer.filters[:, :, height - 1 - y, width - 1 - x].astype(float)
        top, left = height + y - row, width + x - column
        seen = wide[
            :,
            top : top + rows * layer.stride : layer.stride,
            left : left + columns * layer.stride : layer.stride,
        ]
        found += np.tensordot(taps, seen, 1)
    return found


def to_space(planes, times):
    """From depth to space: a channel's `times`² planes become its pixels, row by row."""
    channels, rows, columns = len(planes) // times**2, *planes.shape[1:]
    found = np.zeros((channels, rows * times, columns * times))
    for channel, y, x in np.ndindex(channels, times, times):
        found[channel, y::times, x::times] = planes[(channel * times + y) * times + x]
    return found


def picture(layers, sums, step):
    """From the sums of the first layer, which is conditioned on K already."""
    height, width = sums.shape[1:]
    sums = np.pad(sums, ((0, 0), (0, -height % step), (0, -width % step)), mode="symmetric")
    planes = []
    for index, layer in enumerate(layers):
        if index:
            source = planes[index - 1 if layer.input is None else layer.input]
            sums = to_space(filtered(source, layer), layer.upsampling)
        if layer.skip is not None:
            sums = sums + planes[layer.skip]
        if layer.coefficients is not None:
            bent = [
                networks.spline(plane, coefficients.astype(float), layer.start, layer.spacing)
                for plane, coefficients in zip(sums, layer.coefficients, strict=True)
            ]
            planes.append(np.array(bent))
        else:
            planes.append(sums)
    return planes[-1][0, :height, :width]


def shares(bits, between, number):
    """How much of each set a network has that is told K: cubic B-splines at log2 K."""
    low, high = np.log2(between)
    spacing = (high - low) / (number - 3)
    knots = low + spacing * (np.arange(number + 4) - 3)
    place = np.clip(np.log2(bits), low, high - 1e-12)
    return np.array([float(BSpline(knots, one, 3)(place)) for one in np.eye(number)])


def conditioned(layers, bits, between, number):
    """The layers of a network that is told K, for counts."""
    part = shares(bits, between, number)
    found = []
    for index, layer in enumerate(layers):
        filters, coefficients = layer.filters.astype(float), layer.coefficients
        if filters.ndim == 5:
            filters = np.tensordot(part, filters, 1)
        if index == 0:
            filters = filters / bits
        if coefficients is not None and coefficients.ndim == 3:
            coefficients = np.tensordot(part, coefficients.astype(float), 1)
        found.append(dataclasses.replace(layer, filters=filters, coefficients=coefficients))
    return found


def lively(network, rng, size=0.3):
    """The network with noise on all that training may change."""
    layers = []
    for layer in network.layers:
        changes = {}
        if layer.trainable != "nothing":
            noise = rng.normal(0, size / np.sqrt(layer.filters[0].size), layer.filters.shape)
            changes["filters"] = layer.filters + noise.astype(np.float32)
        if layer.trainable == "all" and layer.coefficients is not None:
            noise = rng.normal(0, size, layer.coefficients.shape)
            changes["coefficients"] = layer.coefficients + noise.astype(np.float32)
        layers.append(dataclasses.replace(layer, **changes))
    return jl.Network(layers, network.sensor, trials_range=network.trials_range)


def wired(rng, sensor, *, tied=True, odd=False):
    """A bit of everything: strides of 2 and 3, and filters that these divide, or do not."""
    block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)

    def layer(outputs, inputs, height, width, *, upsampling=1, splines=True, **options):
        shape = (outputs * upsampling**2, inputs, height, width)
        taps = rng.normal(0, 1 / np.sqrt(np.prod(shape[1:])), shape)
        coefficients = rng.normal(0, 1, (outputs, 9)) if splines else None
        return jl.Layer(taps, coefficients, -2.0, 0.6, upsampling=upsampling, **options)

    first = rng.normal(0, 2 / sensor.bits_per_pixel, (3, *block))
    return jl.Network(
        [
            jl.Layer(first, rng.normal(0, 1, (3, 11)), -2.0, 0.7),
            layer(4, 3, 4 + odd, 2, stride=2),
            layer(2, 4, 3, 6 - odd, stride=3, splines=False),
            layer(4, 2, 1, 1, upsampling=3, skip=1),
            layer(4, 4, 3, 3, splines=False),
            layer(2, 3, 1, 3, input=0),
            layer(2, 4, 2, 2, input=4, upsampling=2, skip=5),
            layer(1, 2, 3, 1, splines=False),
        ],
        sensor,
    )
