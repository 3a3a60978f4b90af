"""The image that most tasks use, and its bits."""

import functools

import numpy as np

import jotlight as jl

HEIGHT, WIDTH = 321, 481
"""The size of the Berkeley images."""
PIXELS = HEIGHT * WIDTH
SENSOR = jl.Sensor(oversampling=4)


@functools.cache
def photograph() -> np.ndarray:
    return np.ascontiguousarray(jl.datasets.photograph("camera")[:HEIGHT, :WIDTH])


@functools.cache
def bits() -> jl.Bits:
    return SENSOR.expose(photograph(), rng=0)


@functools.cache
def many_bits() -> jl.Bits:
    """Return the bits of a large image, whose work divides evenly among threads."""
    return SENSOR.expose(np.tile(jl.datasets.photograph("camera"), (4, 4)), rng=0)


def counts(bits: jl.Bits) -> np.ndarray:
    """Return the ones of each pixel, float32 (H, W), for pixels of 4 × 4 jots and one frame.

    NumPy counts packed bits faster than any program here sums unpacked jots.
    """
    assert (len(bits.packed), SENSOR.oversampling) == (1, 4)
    rows = bits.packed.reshape(-1, 4, bits.packed.shape[2])
    # A byte has a row of two pixels.
    halves = np.stack([np.bitwise_count(rows >> 4), np.bitwise_count(rows & 15)], axis=-1)
    pixels = halves.sum(axis=1, dtype=np.uint8).reshape(len(rows), -1)
    return pixels[:, : bits.width // 4].astype(np.float32)


def unpacked(bits: jl.Bits) -> np.ndarray:
    """Return jots as bytes of 0 and 1, (T, H, W)."""
    return np.unpackbits(bits.packed, axis=2, count=bits.width)


def untied(network: jl.Network) -> jl.Network:
    """Return the same network with a weight for each jot, each of them slightly different."""
    first, *rest = network.layers
    sensor = network.sensor
    shape = (len(first.filters), sensor.frames, sensor.oversampling, sensor.oversampling)
    change = 1 + 0.1 * np.random.default_rng(0).uniform(-1, 1, shape)
    filters = (first.filters * change).astype(np.float32)
    layer = jl.Layer(filters, first.coefficients, first.start, first.spacing)
    return jl.Network([layer, *rest], sensor)
