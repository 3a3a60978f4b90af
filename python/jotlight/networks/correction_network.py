"""A network that corrects a classical estimate, with everything that is known about each pixel."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self, cast

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.networks.bounds import output_bounds
from jotlight.networks.conditioning import conditioning_weights, count_sets
from jotlight.networks.correction_layers import build_correction
from jotlight.networks.graph import halo_radius, size_divisor
from jotlight.networks.layer import Layer
from jotlight.networks.network_files import read_network, write_network
from jotlight.sensing.sensor import Sensor

Image = npt.NDArray[np.float32]

_LARGEST_INPUT = np.pi / 2
"""Largest absolute value of a plane."""


class CorrectionNetwork:
    """A K-conditioned network that corrects a classical estimate.

    A subclass states the planes that the network reads.

    Parameters
    ----------
    layers : sequence of Layer
        The first layer has the planes as channels. Those of the last layer are P(b = 1).
    history : mapping, optional
        How the network was made, in values that JSON can hold.
    trials_range : (int, int)
        Smallest and largest K of the network.

    Raises
    ------
    ValueError
        When the layers do not fit each other or the planes.
    """

    planes: ClassVar[int]
    """Number of planes."""
    start: ClassVar[slice]
    """The planes of the classical estimate. There are as many as outputs."""
    title: ClassVar[str]
    """Name of the classical estimate, for the history."""

    def __init__(
        self,
        layers: Sequence[Layer],
        history: Mapping[str, Any] | None = None,
        *,
        trials_range: tuple[int, int],
    ) -> None:
        self.layers = tuple(layers)
        self.trials_range = trials_range
        self.history = dict(history or {})
        self.sensor, self.tied = Sensor(), True
        self.rotations = 1
        """Number of rotations of the planes over which the output is averaged, 1 to 4.

        A file does not store it.
        """
        self._check_layers()
        output_bounds(self.layers, _LARGEST_INPUT)

    @classmethod
    def initial(
        cls,
        architecture: str = "medium",
        *,
        trials_range: tuple[int, int] = (1, 256),
        rng: int | None = None,
    ) -> Self:
        """Return an untrained network, whose output is its start, the classical estimate.

        Parameters
        ----------
        architecture : {"small", "medium", "large"}
            Layers and channels: :data:`jotlight.networks.architectures.ARCHITECTURES`.
        trials_range : (int, int)
            Smallest and largest K, the number of trials per pixel.
        rng : int, optional
            Seed of the filters. Default: a fresh one.
        """
        layers = build_correction(architecture, cls.planes, cls.start, np.random.default_rng(rng))
        history = {"start": f"{architecture}, starts at {cls.title}"}
        return cls(layers, history, trials_range=trials_range)

    @classmethod
    def outputs(cls) -> int:
        """Return the number of output channels."""
        return len(range(cls.planes)[cls.start])

    @property
    def halo(self) -> int:
        """Radius of the receptive field in pixels, without that of the classical estimate."""
        return halo_radius(self.layers)

    def check_sensor(self, sensor: Sensor) -> None:
        """Raise ValueError for a sensor whose kernel spreads light over several pixels."""
        if sensor.kernel != "box":
            raise ValueError(
                f"sensor: expected the box kernel for a {type(self).__name__}, got {sensor.kernel}"
            )

    def estimate_probability(
        self,
        planes: Image,
        trials: float,
        *,
        threads: int | None = None,
    ) -> Image:
        """Return P(b = 1) of each output channel, (C, H, W).

        Parameters
        ----------
        planes : ndarray of float32, shape (P, H, W)
            The planes.
        trials : float
            The usual number of readings behind a pixel. Outside of the range of the network, the
            nearest parameters are used.
        threads : int, optional
            Number of threads. Default: all.
        """
        served = float(np.clip(trials, *self.trials_range))
        weights = conditioning_weights(served, self.trials_range, count_sets(self.layers))
        layers = [layer.interpolate(weights).engine_layer for layer in self.layers]
        total = np.zeros((self.outputs(), *planes.shape[1:]), np.float32)
        for turns in range(self.rotations):
            turned = np.ascontiguousarray(np.rot90(planes, turns, (1, 2)))
            out = np.empty((len(total), *turned.shape[1:]), np.float32)
            engine.forward(layers, [turned], [out], threads)
            total += np.rot90(out, -turns, (1, 2))
        total /= np.float32(self.rotations)
        return total

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to a `.safetensors` file."""
        write_network(path, self)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the network in a file that :meth:`save` wrote. No code in the file is executed.

        Raises
        ------
        OSError, ValueError
            When the file does not exist, or is not the file of such a network.
        """

        def make(
            layers: Sequence[Layer], _: Sensor, history: Mapping[str, Any], **options: Any
        ) -> "CorrectionNetwork":
            return cls(layers, history, trials_range=options["trials_range"])

        return cast(Self, read_network(path, make))

    def _check_layers(self) -> None:
        if not self.layers:
            raise ValueError("layers: expected at least one, got none")
        size_divisor(self.layers)
        found = self.layers[0].channels, self.layers[-1].channels
        if found != (self.planes, self.outputs()) or self.layers[0].shape[1:] != (1, 1, 1):
            raise ValueError(
                f"layers: expected {self.planes} channels of the first layer and "
                f"{self.outputs()} of the last one, got {found[0]} and {found[1]}"
            )
        count_sets(self.layers)
