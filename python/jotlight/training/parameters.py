"""All parameters of a network as one vector: a = vec({h1, w1, h2, w2}), equation (12)."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.networks.network import Network

Vector = npt.NDArray[np.float64]


def parameter_vector(network: Network) -> Vector:
    """Give the parameters in the order of the layers, of each first the filters.

    Examples
    --------
    >>> from jotlight import Sensor
    >>> parameter_vector(Network.initial(Sensor(oversampling=4))).shape  # 1 + 150 + 15 * 15 + 150
    (526,)
    """
    arrays = [
        array.ravel()
        for layer in network.layers
        for array in (layer.filters, layer.coefficients)
        if array is not None
    ]
    return np.concatenate(arrays).astype(np.float64)


def split_vector(network: Network, vector: Vector) -> Iterator[tuple[Vector, Vector]]:
    """Give each layer's filters and coefficients as views of the vector, in their shapes."""
    start = 0
    for layer in network.layers:
        parts = []
        for array in (layer.filters, layer.spline_coefficients):
            parts.append(vector[start : start + array.size].reshape(array.shape))
            start += array.size
        yield parts[0], parts[1]
    if start != vector.size:
        raise ValueError(f"vector: expected {start} parameters, got {vector.size}")


def with_parameters(network: Network, vector: Vector) -> Network:
    """Give a network like this one with other parameters."""
    layers = [
        dataclasses.replace(
            layer,
            filters=filters.astype(np.float32),
            coefficients=coefficients.astype(np.float32),
        )
        for layer, (filters, coefficients) in zip(
            network.layers, split_vector(network, vector), strict=True
        )
    ]
    return Network(layers, network.sensor, network.history)


def engine_layers(network: Network, vector: Vector, dtype: npt.DTypeLike = np.float32) -> list[Any]:
    """Give the layers as the engine takes them, in 32 bits to work or in 64 to check."""
    return [
        layer.to_engine(
            np.ascontiguousarray(filters, dtype), np.ascontiguousarray(coefficients, dtype)
        )
        for layer, (filters, coefficients) in zip(
            network.layers, split_vector(network, vector), strict=True
        )
    ]
