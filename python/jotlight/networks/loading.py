"""The kinds of networks, and the network in a file, of any kind."""

import os
from typing import Any, get_args

from jotlight.networks.files.network_files import count_planes
from jotlight.networks.network import Network
from jotlight.networks.planes_network import ColorNetwork, FilmNetwork, PlanesNetwork

AnyNetwork = Network | ColorNetwork
"""A network for gray images, or for colors."""


def load_network(path: str | os.PathLike[str]) -> Network | PlanesNetwork:
    """Return the network in a file: for gray images, for colors, or for films.

    The errors are those of :meth:`jotlight.Network.load`.

    Examples
    --------
    >>> from jotlight.networks.pretrained import FILM_FILE
    >>> type(load_network(FILM_FILE)).__name__
    'FilmNetwork'
    """
    kinds = {kind.planes: kind for kind in (ColorNetwork, FilmNetwork)}
    return kinds.get(count_planes(path), Network).load(path)


def require_network(name: str, network: object, kinds: Any, call: str) -> None:
    """Raise TypeError unless an argument is a network of one of some kinds, with a valid call.

    Examples
    --------
    >>> require_network("network", "small", Network, "fine_tune(jotlight.pretrained(sensor), bits)")
    Traceback (most recent call last):
      ...
    TypeError: network: expected jotlight.Network, as in fine_tune(...), got 'small'
    """
    if isinstance(network, kinds):
        return
    got = wrong_network(network)
    if got is None:
        got = repr(network) if isinstance(network, str) else type(network).__name__
    names = " or ".join(f"jotlight.{kind.__name__}" for kind in get_args(kinds) or [kinds])
    raise TypeError(f"{name}: expected {names}, as in {call}, got {got}")


def wrong_network(network: object) -> str | None:
    """Return what was passed in place of a network, and what to pass; None if that is unknown.

    Examples
    --------
    >>> wrong_network("own.safetensors"), wrong_network("small")
    ("a path; pass jotlight.Network.load('own.safetensors')", None)
    """
    if isinstance(network, str | os.PathLike) and os.fspath(network).endswith(".safetensors"):
        return f"a path; pass jotlight.Network.load({os.fspath(network)!r})"
    if isinstance(network, FilmNetwork):
        return (
            "a film network; jotlight.FilmEstimates(network) estimates the images of a film with it"
        )
    if callable(getattr(network, "to_network", None)):
        return "a module of jotlight.torch; pass module.to_network()"
    return None


def load_image_network(path: str | os.PathLike[str]) -> AnyNetwork:
    """Return the network in a file, for gray images or for colors.

    Raises
    ------
    ValueError
        When it is a network for films. The other errors are those of :meth:`jotlight.Network.load`.

    Examples
    --------
    >>> from jotlight.networks.pretrained import MOSAIC_FILE
    >>> type(load_image_network(MOSAIC_FILE)).__name__
    'ColorNetwork'
    """
    network = load_network(path)
    if not isinstance(network, AnyNetwork):
        raise ValueError(
            f"{path}: expected a network for images, got a film network; `jotlight film --motion "
            "--recurrent` uses the one that comes with jotlight"
        )
    return network
