"""The networks whose errors were measured on photographs."""

import numpy as np

from jotlight.evaluation.methods import find_method
from jotlight.networks.layer import Layer
from jotlight.networks.network import Network
from jotlight.networks.pretrained import DEFAULT_SIZE, pretrained, pretrained_conditional
from jotlight.sensing.sensor import Sensor

_MEASURED_SIZES = DEFAULT_SIZE, "large", "extra-large"
"""Sizes of pretrained networks whose errors are as large as those of the error model."""


def reference_network(method: object, quality: str | None, sensor: Sensor) -> tuple[Network, bool]:
    """Return the network from whose errors those of a method are known, and whether it is the same.

    It is the network of the method if its errors were measured. Otherwise, it is "medium".

    Parameters
    ----------
    method : str, Network, or callable, optional
        The method. Default: the pretrained network of the size `quality`.
    quality : str, optional
        The size of the network. Default: the method is no pretrained network.
    sensor : Sensor
        The sensor of the data.

    Examples
    --------
    >>> reference_network("network-large", None, jl.Sensor(frames=16))[1]
    True
    >>> reference_network("admm-tv", None, jl.Sensor(frames=16))[1]
    False
    """
    if isinstance(method, Network):
        return (method, True) if _is_measured(method) else (_medium(sensor), False)
    if isinstance(method, str):
        quality = find_method(method).quality
    if quality in _MEASURED_SIZES:
        network = pretrained(sensor, quality)
        if network.trials_range is not None:
            return network, True
    return _medium(sensor), False


def _medium(sensor: Sensor) -> Network:
    """Return the network to whose errors those of other methods are added."""
    return pretrained(sensor, DEFAULT_SIZE)


def _is_measured(network: Network) -> bool:
    """Return whether a network computes what one does whose errors were measured."""
    if network.trials_range is None:
        return False
    return any(
        _have_equal_layers(network, pretrained_conditional(network.sensor, size))
        for size in _MEASURED_SIZES
    )


def _have_equal_layers(network: Network, other: Network) -> bool:
    """Return whether two networks have equal layers, with sets of parameters for the same K."""
    return (
        network.trials_range == other.trials_range
        and len(network.layers) == len(other.layers)
        and all(map(_are_equal, network.layers, other.layers))
    )


def _are_equal(one: Layer, two: Layer) -> bool:
    """Return whether two layers have equal parameters, knots, and wiring."""
    return one.metadata() == two.metadata() and all(
        np.array_equal(getattr(one, name), getattr(two, name))
        for name in ("filters", "coefficients")
    )
