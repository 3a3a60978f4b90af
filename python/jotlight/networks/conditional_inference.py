"""The output of a K-conditioned network for pixels with any numbers of trials."""

from typing import Protocol

import numpy as np

from jotlight.estimators.inverse_response import (
    equivalent_counts,
    intensity_from_complement,
    intensity_from_probability,
)
from jotlight.estimators.trial_levels import count_local_trials
from jotlight.networks.inference import Inference
from jotlight.networks.trials_map import ConditionalDenoiser, Image, denoise_fractions
from jotlight.networks.zeros import (
    ConditionalNetwork,
    ZerosNetwork,
    estimates_zeros,
    zero_layers,
)
from jotlight.sensing.pixel_counts import GrayImages, PixelCounts
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

_PIXELS_AT_ONCE = 1 << 21
"""Number of pixels whose probabilities become intensities in one call."""


class Network(ConditionalNetwork, ConditionalDenoiser, Protocol):
    """A K-conditioned network."""


def estimate_intensity(
    network: Network, images: GrayImages, sensor: Sensor, threads: int | None
) -> Image:
    """Return the intensities of the probabilities of :func:`estimate_probability`, (N, H, W)."""
    estimate = estimate_probability(network, images, sensor, threads)
    is_zeros = estimates_zeros(network.layers, sensor)
    convert = intensity_from_complement if is_zeros else intensity_from_probability
    # In place: memory may not hold the estimate twice.
    pixels = estimate.reshape(-1)
    for start in range(0, len(pixels), _PIXELS_AT_ONCE):
        part = pixels[start : start + _PIXELS_AT_ONCE]
        part[:] = convert(part, sensor, threads)
    return estimate


def estimate_probability(
    network: Network, images: GrayImages, sensor: Sensor, threads: int | None
) -> Image:
    """Return the probability P(b = 1) of the sensor's reference jot at each pixel, (N, H, W).

    For bright sensors, it is P(b = 0) instead (:mod:`jotlight.networks.zeros`).

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
    network: Network, pixels: PixelCounts, sensor: Sensor, threads: int | None
) -> Image:
    """Return the probabilities of one image, or of several whose trials are one number."""
    assert network.trials_range is not None, "a K-conditioned network"
    smallest, largest = network.trials_range
    reference = reference_jot(sensor)
    trials = count_local_trials(pixels)
    is_zeros = estimates_zeros(network.layers, sensor)
    if not isinstance(trials, np.ndarray) and smallest <= trials <= largest:
        layers = zero_layers(network, trials) if is_zeros else network.conditioned_layers(trials)
        return Inference(layers, sensor, reference, threads).run_pixels(pixels, trials)
    fraction = equivalent_counts(pixels, reference, 1.0, threads)
    denoiser: ConditionalDenoiser = network
    if is_zeros:
        fraction, denoiser = 1 - fraction, ZerosNetwork(network, network.halo)
    if isinstance(trials, np.ndarray):
        return denoise_fractions(denoiser, fraction[0], trials[0], threads=threads)[None]
    return denoise_fractions(denoiser, fraction, trials, threads=threads)
