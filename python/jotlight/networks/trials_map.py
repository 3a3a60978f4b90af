"""K-conditioned networks for pixels with different numbers of trials, and for more than they know.

A K-conditioned network is for one K at a time. It is run at some levels of K, each of them where
pixels need it, and pixels between two levels are interpolated.

Beyond the largest K of the network, the noise is weaker than it expects. The network then removes
details together with the noise. So the difference between the data and the estimate is amplified,
until its noise is that of the largest K, and the network denoises it again around the estimate.
"""

import math
from typing import Protocol

import numpy as np
import numpy.typing as npt

from jotlight.estimators.trial_levels import (
    fill_from_nearest,
    level_weights,
    local_trials,
)
from jotlight.networks.regions import cover, widen

Image = npt.NDArray[np.float32]

RATIO_OF_PASS = 16.0
"""Maximum ratio of K to that of the network for one more pass of the network."""


class ConditionalDenoiser(Protocol):
    """A K-conditioned network."""

    @property
    def trials_range(self) -> tuple[int, int] | None:
        """Smallest and largest K."""

    @property
    def halo(self) -> int:
        """Radius of the receptive field in pixels."""

    def denoise_probability(
        self, fraction: Image, trials: int, *, threads: int | None = None
    ) -> Image:
        """Return the probabilities P(b = 1), (H, W), for fractions of ones."""


def denoise_map(
    network: ConditionalDenoiser, ones: Image, trials: Image, *, threads: int | None = None
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
    known = trials > 0
    if not known.any():
        return np.full(ones.shape, 0.5, np.float32)
    fraction = fill_from_nearest(ones / np.where(known, trials, 1), known)
    local = local_trials(fill_from_nearest(trials, known))
    return denoise_fractions(network, fraction, local, threads=threads)


def denoise_fractions(
    network: ConditionalDenoiser,
    fraction: Image,
    trials: int | Image,
    *,
    threads: int | None = None,
) -> Image:
    """Return the probability of a one at each pixel, (H, W), where every pixel has trials.

    Parameters
    ----------
    network : Network
        A K-conditioned network.
    fraction : ndarray of float32, shape (H, W)
        Fraction of ones of each pixel.
    trials : int or ndarray of float32, shape (H, W)
        Number of trials, a number or a map, above 0: that of
        :func:`jotlight.estimators.trial_levels.local_trials`.
    threads : int, optional
        Number of threads.
    """
    assert network.trials_range is not None, "a K-conditioned network"
    smallest, largest = network.trials_range
    if isinstance(trials, np.ndarray):
        served: int | Image = np.clip(trials, smallest, largest)
    else:
        served = min(max(trials, smallest), largest)
    estimate = _denoise_at_levels(network, fraction, served, threads)
    excess = float(np.max(trials)) / largest
    if excess <= 1:
        return estimate
    data = _stabilize(fraction, trials)
    gain = np.sqrt(trials / served, dtype=np.float32)
    for _ in range(math.ceil(math.log(excess, RATIO_OF_PASS))):
        base = np.arcsin(np.sqrt(estimate))
        raised = np.clip(base + gain * (data - base), 0, np.pi / 2)
        denoised = _denoise_at_levels(network, _fraction(raised, served), served, threads)
        lowered = base + (np.arcsin(np.sqrt(denoised)) - base) / gain
        estimate = np.sin(np.clip(lowered, 0, np.pi / 2)) ** 2
    return np.asarray(estimate, np.float32)


def _denoise_at_levels(
    network: ConditionalDenoiser, fraction: Image, trials: int | Image, threads: int | None
) -> Image:
    """Return the probabilities in [0, 1], interpolated between the levels of K."""
    if not isinstance(trials, np.ndarray):
        return np.clip(network.denoise_probability(fraction, trials, threads=threads), 0, 1)
    result, halo = np.zeros(fraction.shape, np.float32), network.halo
    for level, weight in level_weights(trials):
        for region in cover(weight > 0, halo):
            rows, columns = widen(region, halo, fraction.shape)
            part = np.ascontiguousarray(fraction[rows, columns])
            denoised = network.denoise_probability(part, level, threads=threads)
            top, left = region[0].start - rows.start, region[1].start - columns.start
            height, width = result[region].shape
            inner = denoised[top : top + height, left : left + width]
            result[region] += weight[region] * inner
    return np.clip(result, 0, 1)


def _stabilize(fraction: Image, trials: int | Image) -> Image:
    """Return the angles whose noise is 1/(4K): arcsin √((L + ⅜)/(K + ¾))."""
    return np.asarray(np.arcsin(np.sqrt((fraction * trials + 0.375) / (trials + 0.75))))


def _fraction(angles: Image, trials: int | Image) -> Image:
    """Return the inverse of :func:`_stabilize`."""
    ones = np.sin(angles) ** 2 * (trials + np.float32(0.75)) - np.float32(0.375)
    return np.asarray(ones / trials, np.float32)
