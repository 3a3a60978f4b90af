"""A network that improves classical colors with the bits of all filters or channels."""

from jotlight.networks.network import Network
from jotlight.networks.planes.color_planes import PLANES, START
from jotlight.networks.planes_network import PlanesNetwork


class ColorNetwork(PlanesNetwork):
    """A K-conditioned network that improves classical colors with the bits of all filters.

    :func:`jotlight.reconstruct` uses one for sensors with a mosaic, and one for color channels.

    Parameters
    ----------
    layers : sequence of Layer
        The first layer has the planes of :mod:`jotlight.networks.planes.color_planes`, and the last
        one three channels: P(b = 1) of red, green, and blue.
    history : mapping, optional
        How the network was made, in values that JSON can hold.
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

    planes, start = PLANES, tuple(range(PLANES)[START])
    estimate = "classical colors"
    usual_range = 1, 256


AnyNetwork = Network | ColorNetwork
"""A network for gray images, or for colors."""
