"""K-conditioned networks that read planes: other estimates of an image, and what its bits add."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self, cast

import numpy as np
import numpy.typing as npt

from jotlight.networks.conditioning import count_sets
from jotlight.networks.description import repr_of
from jotlight.networks.engine_backed import EngineBacked
from jotlight.networks.graph import size_divisor
from jotlight.networks.layer import Layer
from jotlight.networks.network_files import read_network, write_network
from jotlight.sensing.sensor import Sensor

Image = npt.NDArray[np.float32]


class PlanesNetwork(EngineBacked):
    """A K-conditioned network that reads planes. A subclass states their number.

    Parameters
    ----------
    layers : sequence of Layer
        The first layer has the planes as channels, and the last one the outputs: P(b = 1).
    history : mapping, optional
        How the network was made, in values that JSON can hold.
    trials_range : (int, int)
        Smallest and largest K of the network.

    Raises
    ------
    ValueError
        When the layers do not fit each other or the planes.
    """

    outputs: ClassVar[int]
    """Number of its outputs."""

    def __init__(
        self,
        layers: Sequence[Layer],
        history: Mapping[str, Any] | None = None,
        *,
        trials_range: tuple[int, int],
    ) -> None:
        self.layers = tuple(layers)
        self.trials_range: tuple[int, int] = trials_range
        self.history = dict(history or {})
        self.sensor, self.tied = Sensor(), True
        self.rotations = 1
        """Number of rotations of the planes over which the output is averaged, 1 to 4.

        A file does not store it.
        """
        self._check_layers()
        _ = self.engine_network  # It refuses layers whose values could overflow.

    def _check_layers(self) -> None:
        layers = self.layers
        if not layers:
            raise ValueError("layers: expected at least one, got none")
        size_divisor(layers)
        first, last = layers[0].channels, layers[-1].channels
        if (first, last) != (self.planes, self.outputs) or layers[0].shape[1:] != (1, 1, 1):
            raise ValueError(
                f"layers: expected {self.planes} channels of the first layer and {self.outputs} of "
                f"the last one, got {first} and {last}"
            )
        count_sets(layers)

    def estimate_probability(
        self,
        planes: Image,
        trials: float,
        *,
        threads: int | None = None,
    ) -> Image:
        """Return P(b = 1) of each output, (C, H, W).

        Parameters
        ----------
        planes : ndarray of float32, shape (P, H, W)
            What the network reads.
        trials : float
            The usual number of readings behind a pixel. Outside of the range of the network, the
            nearest parameters are used.
        threads : int, optional
            Number of threads. Default: all.
        """
        return self.engine_network.improve(planes, trials, threads)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to a `.safetensors` file, with its history as metadata."""
        write_network(path, self)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the network in a file that :meth:`save` wrote. No code in it is executed.

        Raises
        ------
        OSError, ValueError
            When the file does not exist, is no network file, or holds a network of another kind.
        """

        def make(
            layers: Sequence[Layer], _: Sensor, history: Mapping[str, Any], **options: Any
        ) -> "PlanesNetwork":
            return cls(layers, history, trials_range=options["trials_range"])

        return cast(Self, read_network(path, make, planes=cls.planes))

    def __repr__(self) -> str:
        return repr_of(self)
