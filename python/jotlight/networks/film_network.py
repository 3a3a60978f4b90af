"""A network for the images of films, which also reads the last image."""

from jotlight.networks.planes.film_planes import PLANES, START
from jotlight.networks.planes_network import PlanesNetwork


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
    >>> network = jl.FilmNetwork.initial("small", rng=0)
    >>> network.halo
    8
    """

    planes, start = PLANES, (START,)
    estimate = "the gray network"
    usual_range = 4, 1024
