"""K-conditioned networks for pixels with different numbers of trials, and for more than they know.

A K-conditioned network is for one K at a time. The engine runs it at some levels of K, each of them
where pixels need it, and interpolates pixels between two levels.

Beyond the largest K of the network, the noise is weaker than it expects. The network then removes
details together with the noise. So the engine amplifies the difference between the data and the
estimate, until its noise is that of the largest K, and the network denoises it again around the
estimate.
"""

from collections.abc import Sequence

import numpy as np

from jotlight.array_types import Image
from jotlight.estimators.trial_levels import LocalTrials, fill_from_nearest, local_trials
from jotlight.networks.inference.engine_backed import EngineBacked


def denoise_map(
    network: EngineBacked, ones: Image, trials: Image, *, threads: int | None = None
) -> Image:
    """Return the probability of a one at each pixel, (H, W).

    Parameters
    ----------
    network : Network
        A K-conditioned network.
    ones, trials : ndarray of float32, shape (H, W)
        Numbers of ones and of trials of each pixel. Pixels without trials get the value of their
        neighbors.
    threads : int, optional
        The number of threads.
    """
    known = trials > 0
    if not known.any():
        return np.full(ones.shape, 0.5, np.float32)
    fraction = fill_from_nearest(ones / np.where(known, trials, 1), known)
    local = local_trials(fill_from_nearest(trials, known), threads)
    return denoise_fractions(network, fraction[None], [local], threads=threads)[0]


def denoise_fractions(
    network: EngineBacked,
    fractions: Image,
    trials: Sequence[LocalTrials],
    *,
    zeros: bool = False,
    threads: int | None = None,
) -> list[Image]:
    """Return the probabilities of a one at each pixel of images (H, W) that all have trials.

    Parameters
    ----------
    network : Network
        A K-conditioned network.
    fractions : ndarray of float32, shape (N, H, W)
        Fraction of ones of each pixel.
    trials : sequence of int or ndarray of float32, shape (H, W)
        Number of trials of each image, a number or a map, above 0: that of
        :func:`jotlight.estimators.trial_levels.local_trials`.
    zeros : bool
        Whether the fractions are those of zeros, and the probabilities those of a zero.
    threads : int, optional
        The number of threads.
    """
    return network.engine_network.denoise(list(fractions), list(trials), zeros, threads)
