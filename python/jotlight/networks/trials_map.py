"""K-conditioned networks for pixels with different numbers of trials, and for more than they know.

A K-conditioned network is for one K at a time. It is run at some levels of K, and each pixel is
interpolated between the two levels that are nearest to its own K.

Beyond the largest K of the network, the noise is weaker than it expects. Then the contrast is
raised, so that the noise has the strength of the largest K, and lowered again afterward.
"""

import numpy as np
import numpy.typing as npt

from jotlight.networks.network import Network

Image = npt.NDArray[np.float32]

_BASE_SIGMA = 3.0
"""Standard deviation in pixels of the Gaussian filter whose output keeps its contrast."""

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
    gain = np.sqrt(np.maximum(trials / largest, 1)).astype(np.float32)
    if gain.max() > 1:
        fraction, base = _raise_contrast(fraction, trials, gain)
    levels = level_range(float(trials.min()), float(min(trials.max(), largest)))
    place = np.interp(np.log2(trials), np.log2(levels), np.arange(len(levels)))
    result = np.zeros_like(fraction)
    for index, level in enumerate(levels):
        weight = np.maximum(1 - abs(place - index), 0).astype(np.float32)
        if weight.any():
            denoised = network.denoise_probability(fraction, level, threads=threads)
            result += weight * denoised
    if gain.max() > 1:
        result = _lower_contrast(result, base, gain)
    return np.clip(result, 0, 1)


def level_range(smallest: float, largest: float) -> list[int]:
    """Return whole numbers from `smallest` to `largest`, with ratios of at most about 2.

    Examples
    --------
    >>> level_range(3, 100)
    [3, 6, 12, 24, 49, 100]
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


def _raise_contrast(fraction: Image, trials: Image, gain: Image) -> tuple[Image, Image]:
    """Return fractions with raised contrast, and the stabilized base that keeps its contrast."""
    from scipy.ndimage import gaussian_filter

    stabilized = np.arcsin(np.sqrt((fraction * trials + 0.375) / (trials + 0.75)))
    base = gaussian_filter(stabilized, _BASE_SIGMA)
    raised = np.clip(base + gain * (stabilized - base), 0, np.pi / 2)
    return (np.sin(raised) ** 2).astype(np.float32), base.astype(np.float32)


def _lower_contrast(probability: Image, base: Image, gain: Image) -> Image:
    """Return probabilities after the inverse of :func:`_raise_contrast`."""
    stabilized = np.arcsin(np.sqrt(np.clip(probability, 0, 1)))
    lowered = np.clip(base + (stabilized - base) / gain, 0, np.pi / 2)
    return np.asarray(np.sin(lowered) ** 2, np.float32)
