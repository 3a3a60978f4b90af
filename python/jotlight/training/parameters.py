"""All parameters of a network as one vector, a = vec({h1, w1, h2, w2}), equation (12)."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.networks.layer import have_equal_parameters
from jotlight.networks.network import Network
from jotlight.networks.stages import with_stage


def parameter_vector(network: Network) -> Array:
    """Return the parameters, layer by layer: the filters, then the spline coefficients.

    Examples
    --------
    >>> network = jl.Network.initial(jl.Sensor(oversampling=4))
    >>> parameter_vector(network).shape  # 1 + 150 + 15 * 15 + 150
    (526,)
    """
    arrays = [
        array.ravel()
        for layer in network.layers
        for array in (layer.filters, layer.coefficients)
        if array is not None
    ]
    return np.concatenate(arrays).astype(np.float64)


def split_vector(network: Network, vector: Array) -> Iterator[tuple[Array, Array]]:
    """Yield each layer's filters and spline coefficients as views of the vector.

    Raises
    ------
    ValueError
        When the vector has another number of parameters than the network.
    """
    start = 0
    for layer in network.layers:
        views = []
        for array in (layer.filters, layer.spline_coefficients):
            views.append(vector[start : start + array.size].reshape(array.shape))
            start += array.size
        yield views[0], views[1]
    if start != vector.size:
        raise ValueError(f"vector: expected {start} parameters, got {vector.size}")


def with_parameters(network: Network, vector: Array) -> Network:
    """Return the network with the parameters in the vector.

    Its history states that the parameters changed, if they did.
    """
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
    history = network.history
    if not have_equal_parameters(layers, network.layers):
        history = with_stage(history, "parameters set from a vector")
    return Network(layers, network.sensor, history)


def engine_layers(network: Network, vector: Array, dtype: npt.DTypeLike = np.float32) -> list[Any]:
    """Return the engine's description of the layers: float32 for training, float64 for checks."""
    return [
        layer.to_engine(
            np.ascontiguousarray(filters, dtype), np.ascontiguousarray(coefficients, dtype)
        )
        for layer, (filters, coefficients) in zip(
            network.layers, split_vector(network, vector), strict=True
        )
    ]


def fingerprint_network(network: Network) -> str:
    """Return a digest that identifies the parameters and the layers of a network."""
    digest = hashlib.sha256(parameter_vector(network).tobytes())
    for layer in network.layers:
        digest.update(repr((layer.filters.shape, layer.metadata())).encode())
    return digest.hexdigest()
