"""The output of a K-conditioned network for pixels with any numbers of trials."""

from typing import Protocol

import numpy as np

from jotlight.estimators.deconvolution import deconvolve
from jotlight.estimators.inverse_response import (
    equivalent_counts,
    intensity_from_complement,
    intensity_from_probability,
)
from jotlight.estimators.trial_levels import count_local_trials
from jotlight.networks.finer_grid import (
    Prior,
    Squares,
    coarse_counts,
    enlarge,
    estimate_light,
)
from jotlight.networks.inference import Inference, bits_alike
from jotlight.networks.trials_map import ConditionalDenoiser, Image, denoise_fractions
from jotlight.networks.zeros import (
    ConditionalNetwork,
    ZerosNetwork,
    estimates_zeros,
    zero_layers,
)
from jotlight.sensing.gray_outputs import output_of
from jotlight.sensing.merged import Merged, is_finer
from jotlight.sensing.output_images import OutputImages
from jotlight.sensing.pixel_counts import MAX_PIXELS, GrayImages, gray_images
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

_PIXELS_AT_ONCE = 1 << 21
"""Number of pixels whose probabilities become intensities in one call."""


class Network(ConditionalNetwork, ConditionalDenoiser, Protocol):
    """A K-conditioned network."""


def estimate_intensity(
    network: Network,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> Image:
    """Return the intensities of the probabilities of :func:`estimate_probability`, (N, H, W).

    With a smooth kernel, the probabilities state the mean light at the jots of each pixel, and the
    intensities follow by deconvolution.
    """
    if any(is_finer(each) for each in images.data):
        return _estimate_finer(network, images, sensor, output, threads)
    estimate = estimate_probability(network, images, sensor, output, threads)
    is_zeros = estimates_zeros(network.layers, sensor)
    convert = intensity_from_complement if is_zeros else intensity_from_probability
    # In place: memory may not hold the estimate twice.
    pixels = estimate.reshape(-1)
    for start in range(0, len(pixels), _PIXELS_AT_ONCE):
        part = pixels[start : start + _PIXELS_AT_ONCE]
        part[:] = convert(part, sensor, threads)
    if sensor.kernel == "box":
        return estimate
    return np.clip(deconvolve(estimate, sensor), 0, np.float32(sensor.max_intensity))


def _estimate_finer(
    network: Network,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> Image:
    """Return the intensities of counts on a grid of half pixels, (N, H, W)."""
    is_zeros = estimates_zeros(network.layers, sensor)
    denoiser: ConditionalDenoiser = network
    if is_zeros:
        denoiser = ZerosNetwork(network, network.halo)
    prior = Prior(denoiser, sensor, is_zeros, threads)
    scale = sensor.light_per_intensity
    for place, merged in zip(output.images, images.data, strict=True):
        if not isinstance(merged, Merged) or merged.upsample == 1:
            raise ValueError("data: expected the same grid in all images, got different ones")
        coarse = gray_images(coarse_counts(merged))
        own = output_of(coarse, sensor, None)
        enlarged = enlarge(estimate_intensity(network, coarse, sensor, own, threads)[0])
        light = estimate_light(Squares.of(merged), prior, scale * enlarged)
        place[:] = np.clip(light / scale, 0, sensor.max_intensity)
    return output.images


def estimate_probability(
    network: Network,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> Image:
    """Return the probability P(b = 1) of the sensor's reference jot at each pixel, (N, H, W).

    For bright sensors, it is P(b = 0) instead (:mod:`jotlight.networks.zeros`).

    The network runs once for all images with the same number of trials, if it serves them. For
    other images it runs at several levels of K (:mod:`jotlight.networks.trials_map`), once at each
    level for all images.

    Parameters
    ----------
    network : Network
        A K-conditioned network.
    images : GrayImages
        The data.
    sensor : Sensor
        Sensor of the data.
    output : OutputImages
        Images for the result, which are used if they save memory.
    threads : int, optional
        Number of threads. Default: all.
    """
    assert network.trials_range is not None, "a K-conditioned network"
    smallest, largest = network.trials_range
    reference = reference_jot(sensor)
    is_zeros = estimates_zeros(network.layers, sensor)
    denoiser: ConditionalDenoiser = network
    if is_zeros:
        denoiser = ZerosNetwork(network, network.halo)

    def inference(trials: int) -> Inference:
        layers = zero_layers(network, trials) if is_zeros else network.conditioned_layers(trials)
        return Inference(layers, sensor, reference, threads, network.rotations)

    bits = bits_alike(images, sensor) if network.rotations == 1 else None
    if bits is not None and smallest <= sensor.trials <= largest:
        return inference(sensor.trials).run_bits(bits, sensor.trials, output)
    pixels = images.count(sensor, threads)
    trials = count_local_trials(pixels)
    served: dict[int, list[int]] = {}
    others: list[int] = []
    for place, each in enumerate(trials):
        if isinstance(each, int) and smallest <= each <= largest:
            served.setdefault(each, []).append(place)
        else:
            others.append(place)
    if pixels.uniform and not others:
        (level,) = served
        return inference(level).run_pixels(pixels, level, output)
    # The network takes counts of its own K, and fractions of ones where it runs at several K.
    scale = np.ones(len(trials))
    for level, places in served.items():
        scale[places] = level
    values = equivalent_counts(pixels, reference, scale, threads)
    for level, places in served.items():
        values[places] = inference(level).run_counts(values[places])
    number = max(1, MAX_PIXELS // values[0].size)
    for start in range(0, len(others), number):
        places = others[start : start + number]
        own = [trials[place] for place in places]
        fraction = 1 - values[places] if is_zeros else values[places]
        values[places] = denoise_fractions(denoiser, fraction, own, threads=threads)
    return values
