"""K-conditioned networks for pixels with different numbers of trials, and for more than they know.

A K-conditioned network is for one K at a time. It is run at some levels of K, and each pixel is
interpolated between the two levels that are nearest to its own K.

Beyond the largest K of the network, the noise is weaker than it expects. The network then removes
details together with the noise. So the difference between the data and the estimate is amplified,
until its noise is that of the largest K, and the network denoises it again around the estimate.
"""

import math

import numpy as np
import numpy.typing as npt

from jotlight.networks.network import Network

Image = npt.NDArray[np.float32]

_RATIO_OF_PASS = 16.0
"""Maximum ratio of K to that of the network for one more pass of the network."""

_MAX_RATIO = 2.0
"""Maximum ratio of neighboring levels of K."""


def denoise_map(
    network: Network, ones: Image, trials: Image, *, threads: int | None = None
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
        Number of threads.
    """
    assert network.trials_range is not None, "a K-conditioned network"
    largest = network.trials_range[1]
    known = trials > 0
    if not known.any():
        return np.full(ones.shape, 0.5, np.float32)
    fraction = _fill(ones / np.maximum(trials, 1), known)
    trials = _fill(trials, known)
    served = np.minimum(trials, largest)
    estimate = _denoise_at_levels(network, fraction, served, threads)
    excess = float(trials.max()) / largest
    if excess <= 1:
        return estimate
    data = _stabilize(fraction, trials)
    gain = np.sqrt(trials / served)
    for _ in range(math.ceil(math.log(excess, _RATIO_OF_PASS))):
        base = np.arcsin(np.sqrt(estimate))
        raised = np.clip(base + gain * (data - base), 0, np.pi / 2)
        denoised = _denoise_at_levels(network, _fraction(raised, served), served, threads)
        lowered = base + (np.arcsin(np.sqrt(denoised)) - base) / gain
        estimate = np.sin(np.clip(lowered, 0, np.pi / 2)) ** 2
    return np.asarray(estimate, np.float32)


def _denoise_at_levels(
    network: Network, fraction: Image, trials: Image, threads: int | None
) -> Image:
    """Return the probabilities in [0, 1], interpolated between the levels of K."""
    levels = level_range(float(trials.min()), float(trials.max()))
    place = np.interp(np.log2(trials), np.log2(levels), np.arange(len(levels)))
    result = np.zeros_like(fraction)
    for index, level in enumerate(levels):
        weight = np.maximum(1 - abs(place - index), 0).astype(np.float32)
        if weight.any():
            result += weight * network.denoise_probability(fraction, level, threads=threads)
    return np.clip(result, 0, 1)


def level_range(smallest: float, largest: float) -> list[int]:
    """Return whole numbers from `smallest` to `largest`, with ratios of at most about 2.

    Examples
    --------
    >>> level_range(3, 100)
    [3, 5, 10, 17, 31, 56, 100]
    """
    first, last = max(1, round(smallest)), max(1, round(largest))
    steps = max(0, int(np.ceil(np.log2(last / first) / np.log2(_MAX_RATIO) - 1e-9)))
    ratio = (last / first) ** (1 / steps) if steps else 1.0
    return sorted({round(first * ratio**step) for step in range(steps + 1)})


def _fill(values: npt.NDArray[np.floating], known: npt.NDArray[np.bool_]) -> Image:
    """Return an image whose unknown pixels have the values of the nearest known ones."""
    if known.all():
        return values.astype(np.float32)
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)], np.float32)


def _stabilize(fraction: Image, trials: Image) -> Image:
    """Return the angles whose noise is 1/(4K): arcsin √((L + ⅜)/(K + ¾))."""
    return np.asarray(np.arcsin(np.sqrt((fraction * trials + 0.375) / (trials + 0.75))))


def _fraction(angles: Image, trials: Image) -> Image:
    """Return the inverse of :func:`_stabilize`."""
    ones = np.sin(angles) ** 2 * (trials + np.float32(0.75)) - np.float32(0.375)
    return np.asarray(ones / trials, np.float32)
