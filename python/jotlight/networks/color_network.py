"""A network that improves classical colors with the bits of all filters or channels."""

from typing import Self

import numpy as np

from jotlight.networks.color_layers import COLORS, build_color
from jotlight.networks.color_planes import PLANES
from jotlight.networks.network import Network
from jotlight.networks.planes_network import PlanesNetwork
from jotlight.sensing.sensor import Sensor


class ColorNetwork(PlanesNetwork):
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

    planes, outputs = PLANES, COLORS

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


AnyNetwork = Network | ColorNetwork
"""A network for gray images, or for colors."""
