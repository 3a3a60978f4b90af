"""K-conditioned networks for pixels with different numbers of trials, and for more than they know.

A K-conditioned network is for one K at a time. It is run at some levels of K, each of them where
pixels need it, and pixels between two levels are interpolated.

Beyond the largest K of the network, the noise is weaker than it expects. The network then removes
details together with the noise. So the difference between the data and the estimate is amplified,
until its noise is that of the largest K, and the network denoises it again around the estimate.
"""

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from jotlight.estimators.trial_levels import (
    LocalTrials,
    fill_from_nearest,
    local_trials,
    share_levels,
)
from jotlight.networks.regions import cover

Image = npt.NDArray[np.float32]

RATIO_OF_PASS = 16.0
"""Maximum ratio of K to that of the network for one more pass of the network."""


_SHARE_OF_HALO = 2
"""A region has a halo around it: that of the network divided by this number.

The outer half of the receptive field changes estimates by about 1e-4 of the intensity, and the
weights of a level tend to 0 at the border of its region.
"""


class ConditionalDenoiser(Protocol):
    """A K-conditioned network."""

    @property
    def trials_range(self) -> tuple[int, int] | None:
        """Smallest and largest K."""

    @property
    def halo(self) -> int:
        """Radius of the receptive field in pixels."""

    def denoise_probabilities(
        self, fractions: Sequence[Image], trials: int, *, threads: int | None = None
    ) -> list[Image]:
        """Return the probabilities P(b = 1) of images (H, W) of any size."""


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
    return np.asarray(denoise_fractions(network, fraction[None], [local], threads=threads)[0])


def denoise_fractions(
    network: ConditionalDenoiser,
    fractions: Image,
    trials: Sequence[LocalTrials],
    *,
    threads: int | None = None,
) -> Image:
    """Return the probability of a one at each pixel, (N, H, W), where every pixel has trials.

    Parameters
    ----------
    network : Network
        A K-conditioned network.
    fractions : ndarray of float32, shape (N, H, W)
        Fraction of ones of each pixel.
    trials : sequence of int or ndarray of float32, shape (H, W)
        Number of trials of each image, a number or a map, above 0: that of
        :func:`jotlight.estimators.trial_levels.local_trials`.
    threads : int, optional
        Number of threads.
    """
    assert network.trials_range is not None, "a K-conditioned network"
    smallest, largest = network.trials_range
    served = _clip(trials, smallest, largest)
    estimates = _denoise_at_levels(network, fractions, served, threads)
    excess = np.array([float(np.max(each)) for each in trials]) / largest
    passes = np.ceil(np.log(np.maximum(excess, 1)) / math.log(RATIO_OF_PASS))
    for number in range(int(passes.max())):
        places = np.flatnonzero(passes > number).tolist()
        own, own_served = ([values[place] for place in places] for values in (trials, served))
        n, n_served = _as_array(own), _as_array(own_served)
        gain = np.sqrt(n / n_served)
        base = np.arcsin(np.sqrt(estimates[places]))
        data = _stabilize(fractions[places], n)
        raised = np.clip(base + gain * (data - base), 0, np.pi / 2)
        # Only pixels with more trials than the network serves change.
        levels = [largest] * len(places)
        denoised = _denoise_at_levels(network, _fraction(raised, n_served), levels, threads)
        lowered = base + (np.arcsin(np.sqrt(denoised)) - base) / gain
        changed = np.sin(np.clip(lowered, 0, np.pi / 2)) ** 2
        estimates[places] = np.where(gain > 1, changed, estimates[places])
    return estimates


def _clip(trials: Sequence[LocalTrials], smallest: int, largest: int) -> list[LocalTrials]:
    """Return the trials that the network serves. Images with the same map keep a common one."""
    clipped: dict[int, LocalTrials] = {}
    for each in trials:
        if id(each) not in clipped:
            if isinstance(each, np.ndarray):
                clipped[id(each)] = np.clip(each, smallest, largest)
            else:
                clipped[id(each)] = min(max(each, smallest), largest)
    return [clipped[id(each)] for each in trials]


def _as_array(trials: Sequence[LocalTrials]) -> Image:
    """Return the trials as an array that broadcasts with the images (N, H, W)."""
    each = [np.atleast_2d(np.asarray(one, np.float32)) for one in trials]
    if len({one.shape for one in each}) > 1:
        each = list(np.broadcast_arrays(*each))
    return np.stack(each)


def _denoise_at_levels(
    network: ConditionalDenoiser,
    fractions: Image,
    trials: Sequence[LocalTrials],
    threads: int | None,
) -> Image:
    """Return the probabilities in [0, 1], interpolated between the levels of K."""
    result, halo = np.zeros(fractions.shape, np.float32), -(-network.halo // _SHARE_OF_HALO)
    for level, groups in share_levels(trials):
        parts = [
            (image, band, weights)
            for images, weights in groups
            for band in ([None] if weights is None else cover(weights > 0, halo))
            for image in images
        ]
        inputs = [
            np.ascontiguousarray(fractions[image] if band is None else band.cut(fractions[image]))
            for image, band, _ in parts
        ]
        outputs = network.denoise_probabilities(inputs, level, threads=threads)
        for (image, band, weights), output in zip(parts, outputs, strict=True):
            if band is None or weights is None:
                result[image] += output
                continue
            for place, values in band.pieces(output):
                result[image][place] += weights[place] * values
    return np.clip(result, 0, 1, out=result)


def _stabilize(fractions: Image, trials: Image) -> Image:
    """Return the angles whose noise is 1/(4K): arcsin √((L + ⅜)/(K + ¾))."""
    ones = fractions * trials + np.float32(0.375)
    return np.asarray(np.arcsin(np.sqrt(ones / (trials + np.float32(0.75)))))


def _fraction(angles: Image, trials: Image) -> Image:
    """Return the inverse of :func:`_stabilize`."""
    ones = np.sin(angles) ** 2 * (trials + np.float32(0.75)) - np.float32(0.375)
    return np.asarray(ones / trials, np.float32)
