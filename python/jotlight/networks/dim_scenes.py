"""Dim scenes: a K-conditioned network sees several of their trials as one.

In a dim scene, ones are rare. Then c trials are like one trial whose probability of a one is c
times as large: in both cases, the number of ones is nearly a Poisson number. Networks were trained
for brighter scenes, and hardly any probability that they return is below 1e-4.
"""

import numpy as np
import numpy.typing as npt

from jotlight.estimators.trial_levels import LocalTrials
from jotlight.networks.trials_map import ConditionalNetwork, denoise_fractions

Image = npt.NDArray[np.float32]

_MIN_TRIALS = 16
"""Smallest number of trials that remains."""

_ROOM = 4.0
"""How many times as many trials as ones remain, at least, in nearly all pixels."""

_NEARLY_ALL = 0.999
"""Fraction of the pixels for which there is this room."""

_MIN_FACTOR = 1.5
"""Smallest number of trials per combined trial."""

_FULL = 0.5
"""Fraction of ones of combined trials above which the trials of a pixel are not combined."""

_MARGIN = 8
"""Distance in pixels at which those of other pixels are not combined, either."""

DIM = 1 / (_ROOM * _MIN_FACTOR)
"""Fraction of ones of the brightest pixels below which trials may be combined."""


def combined_trials(fraction: Image, trials: LocalTrials) -> float:
    """Return c, the number of trials per combined trial, or 1 for scenes that are not dim.

    Parameters
    ----------
    fraction : ndarray of float32, shape (H, W)
        Fractions of ones.
    trials : int or ndarray of float32, shape (H, W)
        The local number of trials.

    Examples
    --------
    >>> dim = np.full((8, 8), 1 / 256, np.float32)
    >>> combined_trials(dim, 256), combined_trials(32 * dim, 256), combined_trials(dim, 16)
    (16.0, 2.0, 1.0)
    """
    bright = float(np.quantile(fraction, _NEARLY_ALL))
    typical = float(np.median(trials))
    factor = min(typical / _MIN_TRIALS, 1 / max(_ROOM * bright, 1 / typical))
    return factor if factor >= _MIN_FACTOR else 1.0


def denoise_dim(
    network: ConditionalNetwork,
    fraction: Image,
    trials: LocalTrials,
    *,
    threads: int | None = None,
) -> Image | None:
    """Return the probability of a one at each pixel of a dim scene, (H, W), or None for others.

    Parameters
    ----------
    network : Network
        A K-conditioned network.
    fraction : ndarray of float32, shape (H, W)
        Fractions of ones.
    trials : int or ndarray of float32, shape (H, W)
        The local number of trials, of each pixel if it is an array.
    threads : int, optional
        Number of threads. Default: all.
    """
    if (factor := combined_trials(fraction, trials)) == 1:
        return None
    if isinstance(trials, int):
        number: LocalTrials = max(round(trials / factor), _MIN_TRIALS)
        factor = trials / number
    else:
        number = np.maximum(trials / np.float32(factor), 1)
    scaled = fraction * np.float32(factor)
    combined = np.minimum(scaled, 1)[None]
    found = denoise_fractions(network, combined, [number], threads=threads)[0] / np.float32(factor)
    full = scaled > _FULL
    if not full.any():
        return found
    from scipy.ndimage import maximum_filter

    plain = denoise_fractions(network, fraction[None], [trials], threads=threads)[0]
    return np.asarray(np.where(maximum_filter(full, 2 * _MARGIN + 1), plain, found))
