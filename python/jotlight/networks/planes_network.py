"""K-conditioned networks that read planes: other estimates of an image, and what its bits add.

One improves colors, and one the images of films.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self, cast

from jotlight.array_types import Image
from jotlight.networks.conditioning import count_sets
from jotlight.networks.description import repr_of
from jotlight.networks.files.network_files import read_network, write_network
from jotlight.networks.graph import size_divisor
from jotlight.networks.inference.engine_backed import EngineBacked
from jotlight.networks.layer import Layer
from jotlight.networks.layer_checks import check_rotations
from jotlight.networks.planes import color_planes, film_planes
from jotlight.networks.planes.planes_layers import build_correction
from jotlight.parameter_names import takes_rng
from jotlight.seeds import random_generator
from jotlight.sensing.sensor import Sensor


class PlanesNetwork(EngineBacked):
    """A K-conditioned network that reads planes. A subclass states their number.

    The first layer has the planes as channels, and the last one the outputs: P(b = 1). The
    parameters and the errors are those of the subclasses.
    """

    start: ClassVar[tuple[int, ...]]
    """The planes of the estimate that the network corrects, one for each output."""
    estimate: ClassVar[str]
    """What this estimate is."""
    usual_range: ClassVar[tuple[int, int]]
    """Smallest and largest K of an untrained network."""

    def __init__(
        self,
        layers: Sequence[Layer],
        history: Mapping[str, Any] | None = None,
        *,
        trials_range: tuple[int, int],
        rotations: int = 1,
    ) -> None:
        self.layers = tuple(layers)
        self.trials_range: tuple[int, int] = trials_range
        self.history = dict(history or {})
        self.sensor, self.tied = Sensor(), True
        self.rotations = check_rotations(rotations, tied=self.tied)
        self._check_layers()
        _ = self.engine_network  # It refuses layers whose values could overflow.

    @classmethod
    @takes_rng
    def initial(
        cls,
        architecture: str = "medium",
        *,
        trials_range: tuple[int, int] | None = None,
        rng: int | None = None,
    ) -> Self:
        """Return an untrained network, whose output is the estimate that it corrects.

        Parameters
        ----------
        architecture : {"small", "medium", "large"}
            Layers and channels: :data:`jotlight.networks.architectures.ARCHITECTURES`.
        trials_range : (int, int), optional
            Smallest and largest K, the number of trials per pixel. Default: 1 to 256 for colors,
            and 4 to 1,024 for films.
        rng : int, optional
            Seed of the filters. Default: a fresh one.
        """
        layers = build_correction(architecture, cls.planes, cls.start, random_generator(rng))
        history = {"start": f"{architecture}, starts at {cls.estimate}"}
        return cls(layers, history, trials_range=trials_range or cls.usual_range)

    @staticmethod
    def check_sensor(sensor: Sensor) -> None:
        """Raise ValueError for a sensor whose kernel spreads the light of a point over pixels."""
        if sensor.kernel != "box":
            raise ValueError(f"sensor: expected the box kernel, got {sensor.kernel}")

    def _check_layers(self) -> None:
        layers = self.layers
        if not layers:
            raise ValueError("layers: expected at least one, got none")
        size_divisor(layers)
        first, last, outputs = layers[0].channels, layers[-1].channels, len(self.start)
        if (first, last) != (self.planes, outputs) or layers[0].shape[1:] != (1, 1, 1):
            raise ValueError(
                f"layers: expected {self.planes} channels of the first layer and {outputs} of the "
                f"last one, got {first} and {last}"
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
            The number of threads. Default: the number of cores.
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
            When the file does not exist, is not a network file, or holds another kind of network.
        """

        def make(
            layers: Sequence[Layer], _: Sensor, history: Mapping[str, Any], **options: Any
        ) -> PlanesNetwork:
            return cls(layers, history, **options)

        return cast(Self, read_network(path, make, planes=cls.planes))

    def __repr__(self) -> str:
        return repr_of(self)


class ColorNetwork(PlanesNetwork):
    """A K-conditioned network that improves classical colors with the bits of all filters.

    :func:`jotlight.reconstruct` uses one for sensors with a mosaic, and one for color channels.

    Parameters
    ----------
    layers : sequence of Layer
        The first layer has the planes of :mod:`jotlight.networks.planes.color_planes`, and the last
        one three channels: P(b = 1) of red, green, and blue.
    history : mapping, optional
        Where the parameters came from, in values that JSON can hold: the text `start`, and the list
        `stages` of the training runs and other changes since then.
    trials_range : (int, int)
        Smallest and largest K of the network.
    rotations : {1, 4}
        4 averages the output over the rotations of the planes by 90 degrees.

    Raises
    ------
    ValueError
        When the layers do not fit each other or the planes.

    Examples
    --------
    >>> network = jl.ColorNetwork.initial("small", rng=0)
    >>> network.halo
    8
    """

    planes, start = color_planes.PLANES, tuple(range(color_planes.PLANES)[color_planes.START])
    estimate = "classical colors"
    usual_range = 1, 256


class FilmNetwork(PlanesNetwork):
    """A K-conditioned recurrent network for the images of a film.

    It improves the estimates of the gray network with counts of three lengths along the motion,
    those of neighboring moments, and the last image of the film.
    :class:`jotlight.FilmEstimates` uses it.

    Parameters
    ----------
    layers : sequence of Layer
        The first layer has the planes of :mod:`jotlight.networks.planes.film_planes`, and the last
        one a channel: P(b = 1).
    history : mapping, optional
        Where the parameters came from, in values that JSON can hold: the text `start`, and the list
        `stages` of the training runs and other changes since then.
    trials_range : (int, int)
        Smallest and largest K of the network.
    rotations : {1, 4}
        4 averages the output over the rotations of the planes by 90 degrees.

    Raises
    ------
    ValueError
        When the layers do not fit each other or the planes.

    Examples
    --------
    >>> network = jl.FilmNetwork.initial("small", rng=0)
    >>> network.halo
    8
    """

    planes, start = film_planes.PLANES, (film_planes.START,)
    estimate = "the gray network"
    usual_range = 4, 1024
