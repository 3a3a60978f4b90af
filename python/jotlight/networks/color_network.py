"""A network that improves classical colors with the bits of all filters or channels."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Self, cast

import numpy as np
import numpy.typing as npt

from jotlight.networks.color_layers import COLORS, build_color
from jotlight.networks.color_planes import PLANES
from jotlight.networks.conditioning import count_sets
from jotlight.networks.description import repr_of
from jotlight.networks.engine_backed import EngineBacked
from jotlight.networks.graph import size_divisor
from jotlight.networks.layer import Layer
from jotlight.networks.network import Network
from jotlight.networks.network_files import is_color_network, read_network, write_network
from jotlight.sensing.sensor import Sensor

Image = npt.NDArray[np.float32]


class ColorNetwork(EngineBacked):
    """A K-conditioned network that improves classical colors with the bits of all filters.

    :func:`jotlight.reconstruct` uses one for sensors with a mosaic, and one for color channels.

    Parameters
    ----------
    layers : sequence of Layer
        The first layer has the planes of :mod:`jotlight.networks.color_planes`, and the last one
        three channels: P(b = 1) of red, green, and blue.
    history : mapping, optional
        How the network was made, in values that JSON can hold.
    trials_range : (int, int)
        Smallest and largest K of the network.

    Raises
    ------
    ValueError
        When the layers do not fit each other or the planes.

    Examples
    --------
    >>> network = ColorNetwork.initial("small", rng=0)
    >>> network.halo
    8
    """

    _is_color = True

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
        _check_color_layers(self.layers)
        _ = self.engine_network  # It refuses layers whose values could overflow.

    @classmethod
    def initial(
        cls,
        architecture: str = "medium",
        *,
        trials_range: tuple[int, int] = (1, 256),
        rng: int | None = None,
    ) -> Self:
        """Return an untrained network, whose output is its start, the classical colors.

        Parameters
        ----------
        architecture : {"small", "medium", "large"}
            Layers and channels: :data:`jotlight.networks.architectures.ARCHITECTURES`.
        trials_range : (int, int)
            Smallest and largest K, the number of trials per pixel.
        rng : int, optional
            Seed of the filters. Default: a fresh one.
        """
        layers = build_color(architecture, np.random.default_rng(rng))
        history = {"start": f"{architecture}, starts at classical colors"}
        return cls(layers, history, trials_range=trials_range)

    def check_sensor(self, sensor: Sensor) -> None:
        """Raise ValueError for a sensor whose kernel spreads light over several filters."""
        if sensor.kernel != "box":
            raise ValueError(f"sensor: expected the box kernel for colors, got {sensor.kernel}")

    def estimate_probability(
        self,
        planes: Image,
        trials: float,
        *,
        threads: int | None = None,
    ) -> Image:
        """Return P(b = 1) of red, green, and blue light, (3, H, W).

        Parameters
        ----------
        planes : ndarray of float32, shape (11, H, W)
            The planes of :func:`jotlight.networks.color_planes.color_planes`.
        trials : float
            The usual number of readings behind a pixel. Outside of the range of the network, the
            nearest parameters are used.
        threads : int, optional
            Number of threads. Default: all.
        """
        return self.engine_network.improve_colors(planes, trials, threads)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the color network to a `.safetensors` file, with its history as metadata."""
        write_network(path, self)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the color network in a file that :meth:`save` wrote. No code in it is executed.

        Raises
        ------
        OSError, ValueError
            When the file does not exist, is no network file, or holds a network of gray images,
            which :meth:`jotlight.Network.load` reads.
        """

        def make(
            layers: Sequence[Layer], _: Sensor, history: Mapping[str, Any], **options: Any
        ) -> "ColorNetwork":
            return cls(layers, history, trials_range=options["trials_range"])

        return cast(Self, read_network(path, make, is_color=True))

    def __repr__(self) -> str:
        return repr_of(self)


AnyNetwork = Network | ColorNetwork
"""A network for gray images, or for colors."""


def load_network(path: str | os.PathLike[str]) -> AnyNetwork:
    """Return the network in a file, for gray images or for colors.

    The errors are those of :meth:`jotlight.Network.load`.
    """
    return ColorNetwork.load(path) if is_color_network(path) else Network.load(path)


def _check_color_layers(layers: Sequence[Layer]) -> None:
    if not layers:
        raise ValueError("layers: expected at least one, got none")
    size_divisor(layers)
    first, last = layers[0].channels, layers[-1].channels
    if (first, last) != (PLANES, COLORS) or layers[0].shape[1:] != (1, 1, 1):
        raise ValueError(
            f"layers: expected {PLANES} channels of the first layer and {COLORS} of the last one, "
            f"got {first} and {last}"
        )
    count_sets(layers)
