"""How an image was estimated."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from jotlight.estimators.iterative.convergence import ConvergenceHistories, ConvergenceHistory


@dataclasses.dataclass(frozen=True)
class Info:
    """How an image was estimated."""

    method: str
    """Name of the method, as ``method`` of :func:`reconstruct` takes it; "network" for a network
    of the caller, and the name of a function of the caller."""
    title: str
    """Name of the method in tables."""
    reason: str
    """Why this method was chosen."""
    seconds: float = 0.0
    """Computing time in total. It is 0 until the image is complete."""
    history: ConvergenceHistories | None = dataclasses.field(default=None, repr=False)
    """Progress of an iterative method, or a list of it for each channel; None for others."""
    shares: dict[str, float] | None = None
    """Mean weight of each method in a blend on held-out bits; None for other methods."""

    def found_settings(self) -> dict[str, Any]:
        """Return the settings that the method found from the data, for a record.

        They are the mean over all pixels of the weight of total variation, which differs from pixel
        to pixel, and the shares of a blend.

        Examples
        --------
        >>> bits = jl.Sensor(frames=16).expose(np.full((8, 8), 0.5), rng=0)
        >>> _, info = jl.reconstruct(bits, method="admm-tv", return_info=True)
        >>> list(info.found_settings())
        ['mean_weight']
        """
        settings: dict[str, Any] = {}
        if self.history is not None:
            each = self.history if isinstance(self.history, list) else [self.history]
            weights = [np.mean(h.weight) for h in each if np.ndim(h.weight) > 0]
            if weights:
                settings["mean_weight"] = float(np.mean(weights))
        if self.shares is not None:
            settings["shares"] = self.shares
        return settings


def mean_settings(each: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the means of the settings that a method found for each of some images.

    A share that an image lacks is 0.

    Examples
    --------
    >>> mean_settings([{"mean_weight": 2.0}, {"mean_weight": 3.0}])
    {'mean_weight': 2.5}
    >>> mean_settings([{"shares": {"mle": 1.0}}, {"shares": {"mle": 0.5, "network": 0.5}}])
    {'shares': {'mle': 0.75, 'network': 0.25}}
    """
    means: dict[str, Any] = {}
    for name in dict.fromkeys(name for settings in each for name in settings):
        values = [settings[name] for settings in each if name in settings]
        is_group = isinstance(values[0], dict)
        means[name] = mean_settings(values) if is_group else float(sum(values) / len(each))
    return means


def join_infos(infos: Sequence[Info], ending: str) -> Info:
    """Return how an image of several planes was estimated.

    Parameters
    ----------
    infos : sequence of Info
        How the planes were estimated, all by the same method.
    ending : str
        What follows the estimates of the planes, for the title.

    Returns
    -------
    Info
        How the image was estimated. Its computing time is 0: that of the planes is not all of it.

    Examples
    --------
    >>> one = Info("mle", "maximum likelihood", "requested", 0.5)
    >>> join_infos([one, one], "color differences").title
    'maximum likelihood, color differences'
    """
    first = infos[0]
    histories: list[ConvergenceHistory] = []
    for info in infos:
        if info.history is not None:
            histories += info.history if isinstance(info.history, list) else [info.history]
    shares = None
    if first.shares is not None:
        shares = mean_settings([info.shares or {} for info in infos])
    return dataclasses.replace(
        first,
        title=f"{first.title}, {ending}",
        seconds=0.0,
        history=histories or None,
        shares=shares,
    )
