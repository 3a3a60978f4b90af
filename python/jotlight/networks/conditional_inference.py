"""The output of a K-conditioned network for pixels with any numbers of trials."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from jotlight.estimators.inverse_response import equivalent_counts, intensity_from_probability
from jotlight.estimators.trial_levels import count_local_trials
from jotlight.networks.inference import Inference
from jotlight.networks.layer import Layer
from jotlight.networks.trials_map import ConditionalDenoiser, Image, denoise_fractions
from jotlight.sensing.pixel_counts import GrayImages, PixelCounts
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

_PIXELS_AT_ONCE = 1 << 21
"""Number of pixels whose probabilities become intensities in one call."""


class ConditionalNetwork(ConditionalDenoiser, Protocol):
    """A K-conditioned network, whose layers depend on K."""

    def conditioned_layers(self, trials: int) -> Sequence[Layer]:
        """Return the layers for K = `trials`."""


def estimate_intensity(
    network: ConditionalNetwork, images: GrayImages, sensor: Sensor, threads: int | None
) -> Image:
    """Return the intensities of the probabilities of :func:`estimate_probability`, (N, H, W)."""
    estimate = estimate_probability(network, images, sensor, threads)
    # In place: memory may not hold the estimate twice.
    pixels = estimate.reshape(-1)
    for start in range(0, len(pixels), _PIXELS_AT_ONCE):
        part = pixels[start : start + _PIXELS_AT_ONCE]
        part[:] = intensity_from_probability(part, sensor, threads)
    return estimate


def estimate_probability(
    network: ConditionalNetwork, images: GrayImages, sensor: Sensor, threads: int | None
) -> Image:
    """Return the probability P(b = 1) of the sensor's reference jot at each pixel, (N, H, W).

    Where all trials are equal and the network serves them, it runs once for all images. Otherwise
    it runs for each image, where necessary at several levels of K
    (:mod:`jotlight.networks.trials_map`).

    Parameters
    ----------
    network : Network
        A K-conditioned network.
    images : GrayImages
        The data.
    sensor : Sensor
        Sensor of the data.
    threads : int, optional
        Number of threads. Default: all.
    """
    pixels = images.count(sensor, threads)
    parts = pixels.images() if isinstance(pixels.trials, np.ndarray) else [pixels]
    estimates = [_estimate_alike(network, part, sensor, threads) for part in parts]
    return np.concatenate(estimates) if len(estimates) > 1 else estimates[0]


def _estimate_alike(
    network: ConditionalNetwork, pixels: PixelCounts, sensor: Sensor, threads: int | None
) -> Image:
    """Return the probabilities of one image, or of several whose trials are one number."""
    assert network.trials_range is not None, "a K-conditioned network"
    smallest, largest = network.trials_range
    reference = reference_jot(sensor)
    trials = count_local_trials(pixels)
    if not isinstance(trials, np.ndarray) and smallest <= trials <= largest:
        layers = network.conditioned_layers(trials)
        return Inference(layers, sensor, reference, threads).run_pixels(pixels, trials)
    fraction = equivalent_counts(pixels, reference, 1.0, threads)
    if isinstance(trials, np.ndarray):
        return denoise_fractions(network, fraction[0], trials[0], threads=threads)[None]
    return denoise_fractions(network, fraction, trials, threads=threads)
