"""The check that the layers of a network fit its sensor and its range of K."""

import functools
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from jotlight.checks import shown
from jotlight.networks.conditioning import count_sets
from jotlight.networks.graph import size_divisor
from jotlight.networks.layer import Layer
from jotlight.sensing.sensor import Sensor, require_trainable

T = TypeVar("T")


def check_layers(
    layers: Sequence[Layer], sensor: Sensor, trials_range: tuple[int, int] | None
) -> None:
    """Raise ValueError when layers do not fit each other, the sensor, or the range of K.

    Parameters
    ----------
    layers : sequence of Layer
        Layers of the network.
    sensor : Sensor
        Sensor that the network is for.
    trials_range : (int, int) or None
        Smallest and largest K of a K-conditioned network.
    """
    require_trainable(sensor)
    if not layers:
        raise ValueError("layers: expected at least one, got none")
    block = (sensor.frames, sensor.oversampling, sensor.oversampling)
    if layers[0].shape[1:] not in ((1, 1, 1), block):
        raise ValueError(
            f"layers: expected filters of shape (C, {', '.join(map(str, block))}) in the first "
            f"layer, or (C, 1, 1, 1) when it is tied, got {layers[0].filters.shape}"
        )
    size_divisor(layers)
    if layers[-1].channels != 1:
        raise ValueError(
            f"layers: expected one output channel of the last layer, got {layers[-1].channels}; "
            "jotlight.ColorNetwork has three"
        )
    if trials_range is None:
        if any(layer.set_counts for layer in layers):
            raise ValueError(
                "trials_range: expected a range of K for layers with sets of parameters, got none"
            )
        return
    count_sets(layers)
    is_tied = layers[0].shape[1:] == (1, 1, 1)
    limits = np.asarray(trials_range)
    is_range = limits.shape == (2,) and limits.dtype.kind in "iu" and 1 <= limits[0] < limits[1]
    if not (is_tied and is_range):
        raise ValueError(
            "trials_range: expected the smallest and the largest K of a tied network, got "
            f"{shown(trials_range)}"
        )


def check_rotations(rotations: int, *, tied: bool) -> int:
    """Return the number of rotations over which a network averages; ValueError if it cannot.

    Examples
    --------
    >>> check_rotations(4, tied=True)
    4
    """
    if rotations not in (1, 4):
        raise ValueError(f"rotations: expected 1 or 4, got {rotations!r}")
    if rotations != 1 and not tied:
        raise ValueError(
            "rotations: expected 1 for a network that is not tied, because it weighs the jots of a "
            f"pixel by their places, got {rotations}"
        )
    return int(rotations)


def refuse_rotations(rotations: int, name: str) -> None:
    """Raise ValueError for something that runs a network in one rotation only."""
    if rotations != 1:
        raise ValueError(
            f"network: expected one that does not average over rotations, since {name} run it in "
            f"one, got rotations = {rotations}; use the quality 'large' in place of 'extra-large'"
        )


def require_layers(cls: type[T]) -> type[T]:
    """Return a class of networks whose calls need layers. Other arguments raise a TypeError."""
    initialize: Callable[..., None] = cls.__init__

    @functools.wraps(initialize)
    def initialize_with_layers(self: T, *arguments: object, **keywords: object) -> None:
        layers = arguments[0] if arguments else keywords.get("layers")
        if not isinstance(layers, Sequence) or not all(isinstance(each, Layer) for each in layers):
            raise TypeError(
                f"Network: expected a sequence of jotlight.Layer, and a sensor, got {layers!r}; "
                "Network.load(path) reads a network file, and jotlight.pretrained(sensor) returns "
                "a trained network"
            )
        initialize(self, *arguments, **keywords)

    setattr(cls, "__init__", initialize_with_layers)  # noqa: B010 - mypy refuses an assignment
    return cls
