"""A larger K-conditioned network that computes what a trained smaller one computes.

The additional channels have random filters, but no weight in the old channels. The additional
layers pass the old channels on. So a training of the larger network continues that of the smaller
one (Chen, Goodfellow, and Shlens, "Net2Net", ICLR 2016).
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight import Network
from jotlight.networks.architectures import find_architecture
from jotlight.networks.layer import Layer
from jotlight.networks.splines import fit_spline
from jotlight.networks.stages import with_stage

Array = npt.NDArray[np.float32]

_FIXED_LAYERS = 3
"""Layers of a K-conditioned network before its U-Net."""

_USED_RANGE = 0.95
"""Fraction of the domain of a passing spline that the old values use."""


def widen(network: Network, source: str, target: str, *, seed: int = 0) -> Network:
    """Return a K-conditioned network of the architecture `target` with the estimates of `network`.

    Parameters
    ----------
    network : Network
        A K-conditioned network of the architecture `source`.
    source, target : str
        Architectures with equally many resolutions. The target has at least as many channels and
        layers at each of them.
    seed : int
        Seed of the filters of new channels.
    """
    random = Network.conditional(target, rng=seed)
    origins = [*range(_FIXED_LAYERS), *_origins(source, target)]
    layers: list[Layer] = []
    for index, origin in enumerate(origins):
        layer = random.layers[index]
        if origin is None:
            layers.append(_passing(layer, layers[-1]))
        elif index < _FIXED_LAYERS:
            layers.append(network.layers[origin])
        else:
            layers.append(_embedded(layer, network.layers[origin]))
    history = with_stage(network.history, f"widened from {source} to {target}")
    return Network(layers, random.sensor, history, trials_range=network.trials_range)


def _origins(source: str, target: str) -> list[int | None]:
    """Return the layer of the smaller network for each layer of the larger U-Net, or None."""
    small, large = find_architecture(source), find_architecture(target)
    if len(small.layers) != len(large.layers):
        raise ValueError(f"target: expected the resolutions of {source}, got {target}")
    lowest = len(small.layers) - 1
    levels = [*range(lowest + 1), *reversed(range(lowest))]
    origins: list[int | None] = []
    place = _FIXED_LAYERS
    for position, level in enumerate(levels):
        # The first layer at each resolution but the highest one has no spline.
        begins = int(position > 0)
        kept, wanted = small.layers[level] + begins, large.layers[level] + begins
        origins += [*range(place, place + kept), *[None] * (wanted - kept)]
        place += kept
    return [*origins, place]


def _embedded(layer: Layer, old: Layer) -> Layer:
    """Return a random layer whose first channels are those of a trained one."""
    filters = layer.filters.copy()
    _, outputs, inputs, *_ = old.filters.shape
    filters[:, :outputs, :inputs] = old.filters
    filters[:, :outputs, inputs:] = 0
    coefficients = layer.coefficients
    if coefficients is not None:
        coefficients = coefficients.copy()
        coefficients[..., : old.coefficients.shape[-2], :] = old.coefficients
    return dataclasses.replace(layer, filters=filters, coefficients=coefficients)


def _passing(layer: Layer, before: Layer) -> Layer:
    """Return a random layer that passes the channels of the one before on."""
    filters, coefficients = layer.filters.copy(), layer.coefficients.copy()
    center = filters.shape[-1] // 2
    domain = abs(layer.start)
    # A spline stays between its extreme coefficients.
    largest = np.abs(before.coefficients).max((0, 2))
    identity = fit_spline(lambda z: z, -domain, domain, coefficients.shape[-1])[0][0]
    for channel, value in enumerate(largest):
        scale = _USED_RANGE * domain / max(float(value), 1e-6)
        filters[:, channel] = 0
        filters[:, channel, channel, center, center] = scale
        coefficients[:, channel] = identity / np.float32(scale)
    return dataclasses.replace(layer, filters=filters, coefficients=coefficients)
