"""What a caller requests of a reconstruction: the method, and its settings."""

import dataclasses
from typing import Any, Self, cast

from jotlight.evaluation.choice import Choice, check_fallback, check_precision_of, choose_method
from jotlight.evaluation.color.color_data import (
    BY_COLOR_NETWORK,
    check_color_network,
    check_demosaicing,
)
from jotlight.evaluation.methods import BLEND_METHOD, COLOR_NETWORK
from jotlight.evaluation.own_method import OwnMethod
from jotlight.evaluation.requested_method import check_extras, named_method
from jotlight.networks.loading import AnyNetwork
from jotlight.networks.network import Network
from jotlight.networks.planes_network import ColorNetwork
from jotlight.sensing.sensor import Sensor

AnyMethod = str | AnyNetwork | OwnMethod
"""The name of a method, a network, or a function."""


def with_network_of_module(method: AnyMethod | None) -> AnyMethod | None:
    """Return a method, or the network of a module of :mod:`jotlight.torch`.

    Examples
    --------
    >>> with_network_of_module("mle")
    'mle'
    """
    to_network = getattr(method, "to_network", None)
    return cast(AnyNetwork, to_network()) if callable(to_network) else method


@dataclasses.dataclass(frozen=True)
class Request:
    """A method and its settings, as :func:`jotlight.reconstruct` takes them."""

    method: AnyMethod | None = None
    quality: str | None = None
    demosaicing: str | None = None
    precision: str | None = None
    fallback: bool = False
    options: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Options of the method."""
    threads: int | None = None

    @property
    def is_default(self) -> bool:
        """Whether nothing selects a method."""
        return not (self._names_method or self.fallback)

    @property
    def _names_method(self) -> bool:
        return not (self.method is None and self.quality is None and not self.options)

    @property
    def is_function(self) -> bool:
        """Whether the method is a function of the caller."""
        return callable(self.method) and not isinstance(self.method, AnyNetwork)

    def with_threads(self, threads: int | None) -> Self:
        """Return the same request for a number of threads."""
        return dataclasses.replace(self, threads=threads)

    def settings(self) -> dict[str, Any]:
        """Return the settings that are not the defaults, without the method, its size, and threads.

        Examples
        --------
        >>> Request("admm-tv", precision="f32", options={"weight": 2.0}).settings()
        {'weight': 2.0, 'precision': 'f32'}
        """
        names = ("fallback", "demosaicing", "precision")
        named = {name: getattr(self, name) for name in names if getattr(self, name)}
        return {**self.options, **named}

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of :func:`jotlight.reconstruct`.

        Examples
        --------
        >>> Request("admm-tv", options={"weight": 2.0}).arguments()["weight"]
        2.0
        """
        names = [field.name for field in dataclasses.fields(self) if field.name != "options"]
        return {**{name: getattr(self, name) for name in names}, **self.options}

    def name(self) -> str | None:
        """Return the name of the requested method. None: the best one, or a network of the caller.

        `fallback` alone requests the blend of networks with other methods.

        Raises
        ------
        TypeError, ValueError
            When the method, its options, and `quality` do not belong together.

        Examples
        --------
        >>> Request(quality="small").name(), Request(options={"weight": 2.0}).name()
        ('network-small', 'admm-tv')
        >>> Request(fallback=True).name()
        'held-out'
        """
        if self.fallback and not self._names_method:
            return BLEND_METHOD
        if self.fallback and self.method == COLOR_NETWORK:
            raise ValueError(
                f"fallback: method={BLEND_METHOD!r} blends the color network with other methods; "
                "leave out the method or fallback"
            )
        if not isinstance(self.method, AnyNetwork):
            return named_method(self.method, self.quality, self.options)
        is_color = isinstance(self.method, ColorNetwork)
        check_extras(self.quality, self.options, fallback=self.fallback and is_color)
        return None

    def choose(
        self,
        sensor: Sensor,
        *,
        takes_colors: bool,
        is_range_known: bool = True,
        trials: float | None = None,
    ) -> Choice:
        """Return the method for data of a sensor: the requested one, or the best one.

        Parameters
        ----------
        sensor : Sensor
            The sensor of the data.
        takes_colors : bool
            Whether the data have the form that the color network takes
            (:mod:`jotlight.evaluation.color.color_data`).
        is_range_known, trials
            As of :func:`jotlight.evaluation.choice.choose_method`.

        Raises
        ------
        TypeError, ValueError
            When the method and its settings do not belong together, or not to the sensor.

        Examples
        --------
        >>> mosaic = jl.Sensor(frames=16, mosaic="RGGB")
        >>> Request().choose(mosaic, takes_colors=True).method
        'network-color'
        >>> Request("mle").choose(mosaic, takes_colors=True).method
        'mle'
        >>> Request("held-out").choose(mosaic, takes_colors=True).is_color
        True
        """
        requested = self.name()
        network = self.method if isinstance(self.method, AnyNetwork) else None
        check_demosaicing(self.demosaicing, sensor)
        by_colors = isinstance(network, ColorNetwork) or requested == COLOR_NETWORK
        if by_colors and self.demosaicing not in (None, BY_COLOR_NETWORK):
            raise ValueError("demosaicing: is not an option of a color network; leave it out")
        if sensor.mosaic is not None and not by_colors:
            is_default = takes_colors and self.is_default
            check_color_network(self.demosaicing, is_default=is_default)
        choice = choose_method(
            sensor,
            requested=requested,
            network=network,
            is_range_known=is_range_known,
            is_color=takes_colors,
            demosaicing=self.demosaicing,
            trials=trials,
            is_conditional=self.fallback,
        )
        choice.check_precision(self.precision, fallback=self.fallback)
        return choice

    def choose_unless_own(self, sensor: Sensor, *, takes_colors: bool) -> Choice | None:
        """Return the method for data of a sensor, or None if it is a function of the caller.

        The arguments and errors are those of :meth:`choose`. The settings of a function, and
        `fallback`, are checked, too.

        Examples
        --------
        >>> Request("mle").choose_unless_own(jl.Sensor(), takes_colors=False).method
        'mle'
        >>> Request(np.mean).choose_unless_own(jl.Sensor(), takes_colors=False) is None
        True
        """
        if self.is_function:
            if self.fallback:
                raise ValueError(f"fallback: is for networks, but method is {self.method!r}")
            if self.quality is not None:
                raise ValueError(
                    f"quality: selects a pretrained network, but method is {self.method!r}"
                )
            check_precision_of(self.precision, "a function")
            check_demosaicing(self.demosaicing, sensor)
            check_color_network(self.demosaicing, is_default=False)
            return None
        choice = self.choose(sensor, takes_colors=takes_colors)
        if self.fallback:
            network = self.method if isinstance(self.method, Network) else None
            check_fallback(sensor, choice.method, choice.quality, network)
        return choice

    def of_choice(self, choice: Choice) -> Self:
        """Return the request that names the method that was chosen for it.

        If the color network is recommended, it remains the default: merged images of a film may
        lack bits of a color, so that they need another method.

        Examples
        --------
        >>> request = Request(quality="small")
        >>> request.of_choice(request.choose(jl.Sensor(frames=16), takes_colors=False)).method
        'network-small'
        """
        if isinstance(self.method, AnyNetwork):
            return self
        stays = choice.method == COLOR_NETWORK and not choice.is_requested
        return dataclasses.replace(self, method=None if stays else choice.method, quality=None)
