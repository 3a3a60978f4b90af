"""A network that improves classical colors with the bits of all filters or channels."""

from jotlight.networks.color_planes import PLANES, START
from jotlight.networks.correction_network import CorrectionNetwork


class ColorNetwork(CorrectionNetwork):
    """A K-conditioned network that improves classical colors with the bits of all filters.

    :func:`jotlight.reconstruct` uses one for sensors with a mosaic, and one for color channels. It
    reads the planes of :mod:`jotlight.networks.color_planes`, (11, H, W), and returns P(b = 1) of
    red, green, and blue, (3, H, W).

    Parameters
    ----------
    layers, history, trials_range
        See :class:`jotlight.networks.correction_network.CorrectionNetwork`.

    Examples
    --------
    >>> network = ColorNetwork.initial("small", rng=0)
    >>> network.halo
    8
    """

    planes, start, title = PLANES, START, "classical colors"
