"""Slow twins of networks with strides, upsampling, and skip connections, and random examples."""

import dataclasses

import numpy as np
from scipy.interpolate import BSpline

import jotlight as jl
from reference import networks

SENSOR = jl.Sensor(oversampling=4)


def strided_convolution(image, layer):
    """Equation (9) with a stride, on channels (C, H, W) with mirrored padding."""
    outputs, _, height, width = layer.filters.shape
    above, left = layer.padding
    rows, columns = (size // layer.stride for size in image.shape[1:])
    padded = np.pad(image, ((0, 0), (height, height), (width, width)), mode="symmetric")
    result = np.zeros((outputs, rows, columns))
    for y, x in np.ndindex(height, width):
        # A convolution flips its filter.
        taps = layer.filters[:, :, height - 1 - y, width - 1 - x].astype(float)
        first_row, first_column = height + y - above, width + x - left
        window = padded[
            :,
            first_row : first_row + rows * layer.stride : layer.stride,
            first_column : first_column + columns * layer.stride : layer.stride,
        ]
        result += np.tensordot(taps, window, 1)
    return result


def depth_to_space(channels, factor):
    """`factor`² channels become the pixels of one, row by row."""
    number, rows, columns = len(channels) // factor**2, *channels.shape[1:]
    result = np.zeros((number, rows * factor, columns * factor))
    for channel, y, x in np.ndindex(number, factor, factor):
        result[channel, y::factor, x::factor] = channels[(channel * factor + y) * factor + x]
    return result


def bfloat16(values):
    """The nearest numbers with 8 bits of precision; of two, that with an even last bit."""
    fraction, exponent = np.frexp(np.asarray(values, np.float32).astype(float))
    return np.ldexp(np.round(fraction * 2**8), exponent - 8)


def in_bfloat16(layers):
    """The layers with rounded filters where they read several filtered planes, and the indices of
    the layers whose output is rounded. The error of a tap is added to the next tap of its filter.
    """
    sources = {i: i - 1 if layer.input is None else layer.input for i, layer in enumerate(layers)}
    several = [i for i, source in sources.items() if source > 0 and layers[i].shape[1] > 1]
    changed = list(layers)
    for index in several:
        layer = layers[index]
        taps, error = layer.filters.astype(float), 0
        for place in np.ndindex(layer.shape[2:]):
            exact = taps[:, :, *place] + error
            taps[:, :, *place] = bfloat16(exact)
            error = exact - taps[:, :, *place]
        changed[index] = dataclasses.replace(layer, filters=taps)
    return changed, {sources[index] for index in several}


def output(layers, sums, divisor, rounded=()):
    """The network's output from the sums of its first layer, for layers without parameter sets.

    The outputs of the layers `rounded` become bfloat16.
    """
    height, width = sums.shape[1:]
    sums = np.pad(sums, ((0, 0), (0, -height % divisor), (0, -width % divisor)), mode="symmetric")
    outputs = []
    for index, layer in enumerate(layers):
        if index:
            source = outputs[index - 1 if layer.input is None else layer.input]
            sums = depth_to_space(strided_convolution(source, layer), layer.upsampling)
        if layer.skip is not None:
            sums = sums + outputs[layer.skip]
        if layer.coefficients is not None:
            sums = np.array(
                [
                    networks.spline(channel, coefficients.astype(float), layer.start, layer.spacing)
                    for channel, coefficients in zip(sums, layer.coefficients, strict=True)
                ]
            )
        outputs.append(bfloat16(sums) if index in rounded else sums)
    return outputs[-1][0, :height, :width]


def conditioning_weights(bits, trials_range, number):
    """The values of `number` cubic B-splines at log2 K."""
    low, high = np.log2(trials_range)
    spacing = (high - low) / (number - 3)
    knots = low + spacing * (np.arange(number + 4) - 3)
    position = np.clip(np.log2(bits), low, high - 1e-12)
    return np.array([float(BSpline(knots, one, 3)(position)) for one in np.eye(number)])


def conditioned(layers, bits, trials_range, number):
    """The layers of a K-conditioned network for one K and counts."""
    weights = conditioning_weights(bits, trials_range, number)
    result = []
    for index, layer in enumerate(layers):
        filters, coefficients = layer.filters.astype(float), layer.coefficients
        if filters.ndim == 5:
            filters = np.tensordot(weights, filters, 1)
        if index == 0:
            filters = filters / bits
        if coefficients is not None and coefficients.ndim == 3:
            coefficients = np.tensordot(weights, coefficients.astype(float), 1)
        result.append(dataclasses.replace(layer, filters=filters, coefficients=coefficients))
    return result


def with_noise(network, rng, size=0.3):
    """The network with noise on all trainable parameters."""
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


def residual_network(name, seed=0):
    """A residual network for `SENSOR` whose parameters are all random."""
    return with_noise(jl.Network.residual(SENSOR, name, rng=seed), np.random.default_rng(seed))


def conditional_network(name="small", seed=0):
    """A K-conditioned network whose parameters are all random."""
    return with_noise(jl.Network.conditional(name, rng=seed), np.random.default_rng(seed))


def random_counts(sensor, height, width, seed=0):
    rng = np.random.default_rng(seed)
    return rng.integers(0, sensor.trials + 1, (height, width))


def random_graph(rng, sensor, *, tied=True, odd=False):
    """A network with strides of 2 and 3, upsampling, and skips; `odd` filters exceed multiples."""
    block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)

    def layer(outputs, inputs, height, width, *, upsampling=1, splines=True, **options):
        shape = (outputs * upsampling**2, inputs, height, width)
        taps = rng.normal(0, 1 / np.sqrt(np.prod(shape[1:])), shape)
        coefficients = rng.normal(0, 1, (outputs, 9)) if splines else None
        return jl.Layer(taps, coefficients, -2.0, 0.6, upsampling=upsampling, **options)

    first = rng.normal(0, 2 / sensor.trials, (3, *block))
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
