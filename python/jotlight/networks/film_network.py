"""A network for the images of films, which also reads the last image."""

from typing import Self

import numpy as np

from jotlight.networks.architectures import (
    Builder,
    add_head,
    add_unet,
    find_architecture,
    fit_probability,
    with_sets,
)
from jotlight.networks.film_planes import CENTER, PLANES, START
from jotlight.networks.layer import Layer
from jotlight.networks.planes_network import PlanesNetwork
from jotlight.networks.splines import fit_spline
from jotlight.sensing.sensor import Sensor


class FilmNetwork(PlanesNetwork):
    """A K-conditioned recurrent network for the images of a film.

    It improves the estimates of the gray network with counts of three lengths along the motion, and
    with the last image of the film.
    :class:`jotlight.motion.FilmEstimates` uses it.

    Parameters
    ----------
    layers : sequence of Layer
        The first layer has the planes of :mod:`jotlight.networks.film_planes`, and the last one a
        channel: P(b = 1).
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
    >>> network = FilmNetwork.initial("small", rng=0)
    >>> network.halo
    8
    """

    planes, outputs = PLANES, 1

    @classmethod
    def initial(
        cls,
        architecture: str = "medium",
        *,
        trials_range: tuple[int, int] = (4, 1024),
        rng: int | None = None,
    ) -> Self:
        """Return an untrained network, whose output is its start, the estimate of the gray network.

        Parameters
        ----------
        architecture : {"small", "medium", "large"}
            Layers and channels: :data:`jotlight.networks.architectures.ARCHITECTURES`.
        trials_range : (int, int)
            Smallest and largest K, the number of trials per pixel.
        rng : int, optional
            Seed of the filters. Default: a fresh one.
        """
        layers = _build(architecture, np.random.default_rng(rng))
        history = {"start": f"{architecture}, starts at the gray network"}
        return cls(layers, history, trials_range=trials_range)

    @staticmethod
    def check_sensor(sensor: Sensor) -> None:
        """Raise ValueError for a sensor whose kernel spreads the light of a point over pixels."""
        if sensor.kernel != "box":
            raise ValueError(f"sensor: expected the box kernel, got {sensor.kernel}")


def _build(name: str, rng: np.random.Generator) -> list[Layer]:
    """Return the layers of an untrained film network."""
    taps = np.zeros((1, PLANES, 1, 1), np.float32)
    taps[0, START] = 1
    shift = fit_spline(lambda z: z + CENTER, -CENTER, CENTER, 4)
    planes = Layer(np.ones((PLANES, 1, 1, 1), np.float32), None, trainable="nothing")
    builder = Builder([planes, Layer(taps, *shift, trainable="nothing")], rng)
    add_unet(builder, find_architecture(name), source=0)
    return [with_sets(layer) for layer in add_head(builder, fit_probability(), skip=1)]
