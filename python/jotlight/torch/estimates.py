"""Intensities from the outputs of networks, differentiable, as the engine computes them."""

import math
from collections.abc import Callable
from typing import cast

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jotlight._engine import BRIGHT, RATIO_OF_PASS, Combined
from jotlight.networks.inference.coarse_scales import (
    add_coarse,
    has_few_photons,
    sensor_of_squares,
)
from jotlight.networks.inference.dark_regions import match_dark_regions, may_have_dark_regions
from jotlight.networks.inference.dim_scenes import may_be_dim
from jotlight.sensing.likelihood.reference import reference_jot, response_of
from jotlight.sensing.parameters.response import detection_density, inverse_detection_probability
from jotlight.sensing.sensor import Sensor
from jotlight.squares import sum_squares
from jotlight.torch.response import detection_probability

_MIN_PROBABILITY, _MAX_PROBABILITY = 1e-12, 1 - 2**-24
"""Bounds in float32 within which the derivative of arcsin √p is finite."""


def is_bright(sensor: Sensor) -> bool:
    """Return whether K-conditioned networks with a last spline estimate P(b = 0) for a sensor.

    It is :meth:`jotlight.Network.estimates_zeros`, which torch.compile cannot read.

    Examples
    --------
    >>> is_bright(jl.Sensor()), is_bright(jl.Sensor(gain=25.0))
    (False, True)
    """
    efficiency, dark_counts = reference_jot(sensor)
    rate = efficiency * sensor.light_per_intensity * sensor.max_intensity + dark_counts
    return sensor.threshold == 1 and rate > BRIGHT


def intensity_from_probability(probability: Tensor, sensor: Sensor) -> Tensor:
    """Return the intensity in [0, S] at which bits are 1 with the given probability.

    It is ``c = (K/α)(P⁻¹(q, p) - d)/η``, as in
    :func:`jotlight.estimators.inverse_response.intensity_from_probability`, and differentiable.

    Parameters
    ----------
    probability : Tensor of any shape
        p.
    sensor : Sensor
        The sensor. Medians replace its maps of dark counts and efficiency.

    Examples
    --------
    >>> intensity_from_probability(torch.tensor([0.0, 0.5, 1.0]), jl.Sensor()).numpy().round(4)
    array([0.    , 0.6931, 1.    ], dtype=float32)
    """
    efficiency, dark_counts = reference_jot(sensor)
    light = efficiency * sensor.light_per_intensity
    low, high = (
        _probability(sensor.threshold, light * end + dark_counts)
        for end in (0, sensor.max_intensity)
    )
    p = probability.double().clamp(low, high)
    rate = _inverse(sensor.threshold, p)
    intensity = ((rate - dark_counts) / light).clamp(0, sensor.max_intensity)
    return intensity.to(probability)


def intensity_from_complement(complement: Tensor, sensor: Sensor) -> Tensor:
    """Return the intensity in [0, S] at which bits are 0 with the given probability, for q = 1.

    It is :func:`intensity_from_probability` of 1 - P(b = 0), without rounding errors near 1, and
    differentiable.

    Parameters
    ----------
    complement : Tensor of any shape
        P(b = 0).
    sensor : Sensor
        The sensor. Medians replace its maps of dark counts and efficiency.
    """
    efficiency, dark_counts = reference_jot(sensor)
    light = efficiency * sensor.light_per_intensity
    low = math.exp(-light * sensor.max_intensity - dark_counts)
    rate = -torch.log(complement.double().clamp(low, math.exp(-dark_counts)))
    intensity = ((rate - dark_counts) / light).clamp(0, sensor.max_intensity)
    return intensity.to(complement)


def equivalent_counts(counts: Tensor, sensor: Sensor, dark_counts: float) -> Tensor:
    """Return the counts that a sensor would report with other dark counts.

    They are those of :func:`jotlight.estimators.inverse_response.equivalent_counts`, and
    differentiable.

    Parameters
    ----------
    counts : Tensor of any shape
        L.
    sensor : Sensor
        The sensor, without maps of its jots.
    dark_counts : float
        The other dark counts per jot and frame.

    Examples
    --------
    >>> counts = torch.tensor([0.0, 4.0, 8.0])
    >>> equivalent_counts(counts, jl.Sensor(frames=8, dark_counts=0.1), 0.0).numpy().round(3)
    array([0.   , 3.579, 8.   ], dtype=float32)
    """
    # Below 1, so that the rate and its derivative are finite.
    p = (counts.double() / sensor.trials).clamp(0, 1 - 1e-12)
    rate = (_inverse(sensor.threshold, p) - float(sensor.dark_counts)).clamp(min=0) + dark_counts
    equivalent = sensor.trials * detection_probability(sensor.threshold, rate)
    return equivalent.to(torch.promote_types(counts.dtype, torch.float32))


def _probability(threshold: int, rate: float) -> float:
    """Return P(q, s) as a number, for q = 1 without a tensor, which torch.compile cannot read."""
    if threshold == 1:
        return -math.expm1(-rate)
    return float(detection_probability(threshold, torch.tensor(rate, dtype=torch.float64)))


def _inverse(threshold: int, p: Tensor) -> Tensor:
    """Return P⁻¹(q, p), with its derivative."""
    return -torch.log1p(-p) if threshold == 1 else _find_inverse(threshold, p)


# torch.compile cannot read the function of the engine, and fails where it tries.
@torch.compiler.disable
def _find_inverse(threshold: int, p: Tensor) -> Tensor:
    """Return P⁻¹(q, p), computed in the engine, with its derivative."""
    values = p.detach().cpu().numpy()
    rate = inverse_detection_probability(threshold, values, 1 - values)
    slope = torch.from_numpy(detection_density(threshold, rate)).to(p)
    # A Newton step at the solution does not change it, but carries its derivative. At p = 0, the
    # slope may be 0.
    step = (p - p.detach()) / slope.clamp(min=torch.finfo(p.dtype).tiny)
    return torch.from_numpy(rate).to(p) + torch.where(slope > 0, step, 0)


def probability_of(
    network: Callable[[Tensor, int], Tensor],
    counts: Tensor,
    trials: int,
    trials_range: tuple[int, int],
) -> Tensor:
    """Return P(b = 1) by a K-conditioned network, also for more trials than it knows.

    The passes are those of :func:`jotlight.networks.inference.trials_map.denoise_fractions`.

    Parameters
    ----------
    network : callable
        ``network(counts, K)`` returns P(b = 1) for K in the range.
    counts : Tensor, shape (N, 1, H, W)
        L.
    trials : int
        K, at least the smallest one of the range.
    trials_range : (int, int)
        Smallest and largest K of the network.
    """
    served = min(trials, trials_range[1])
    estimate = network(counts * (served / trials), served).clamp(0, 1)
    if trials == served:
        return estimate
    data = _angle((counts + 0.375) / (trials + 0.75))
    gain = math.sqrt(trials / served)
    for _ in range(math.ceil(math.log(gain**2, RATIO_OF_PASS))):
        base = _angle(estimate)
        raised = (base + gain * (data - base)).clamp(0, math.pi / 2)
        ones = torch.sin(raised) ** 2 * (served + 0.75) - 0.375
        denoised = _angle(network(ones, served))
        lowered = base + (denoised - base) / gain
        estimate = torch.sin(lowered.clamp(0, math.pi / 2)) ** 2
    return estimate


def improve_dim(
    network: Callable[[Tensor, int], Tensor],
    intensity: Tensor,
    counts: Tensor,
    sensor: Sensor,
    trials_range: tuple[int, int],
) -> Tensor:
    """Return the intensities (N, 1, H, W) with those of combined trials for dim scenes.

    They are those of the engine (:mod:`jotlight.networks.inference.dim_scenes`). In other scenes,
    dark regions are those of :func:`jotlight.networks.inference.dark_regions.match_dark_regions`.

    Parameters
    ----------
    network : callable
        ``network(counts, K)`` returns P(b = 1) for K in the range.
    intensity, counts : Tensor, shape (N, 1, H, W)
        The intensities without combination, and L.
    sensor : Sensor
        The sensor, without maps of its jots.
    trials_range : (int, int)
        Smallest and largest K of the network.
    """
    try:
        estimates, fractions = _values(intensity), _values(counts) / np.float32(sensor.trials)
    except RuntimeError:  # the transforms of torch.func hide the values
        return intensity
    images = list(intensity)
    for index, (image, (fraction,)) in enumerate(zip(estimates, fractions, strict=True)):
        found, is_dark = None, may_have_dark_regions(image[0], sensor)
        if may_be_dim(image[0], sensor):
            found = Combined.of(fraction, sensor.trials, trials_range[0])
        if found is not None:
            trials, fractions_of_combined = cast(int, found.trials), found.fractions
            scaled = torch.from_numpy(fractions_of_combined * np.float32(trials))[None, None]
            scaled = scaled.to(intensity.device)
            (probability,) = _values(probability_of(network, scaled, trials, trials_range)[0])
            matched = match_dark_regions(
                probability, fractions_of_combined, trials, sensor.threshold
            )
            matched = matched / np.float32(found.factor)
            weight = found.weights(probability)
        elif is_dark:
            probability = response_of(sensor)(image[0]).astype(np.float32)
            matched = match_dark_regions(probability, fraction, sensor.trials, sensor.threshold)
            weight = (probability < 0.5).astype(np.float32)
        else:
            continue
        better = intensity_from_probability(torch.from_numpy(matched), sensor).to(intensity)
        images[index] = torch.lerp(images[index], better, torch.from_numpy(weight).to(intensity))
    return torch.stack(images) if images else intensity


def improve_coarse(
    estimate: Callable[[Tensor, Sensor], Tensor], intensity: Tensor, counts: Tensor, sensor: Sensor
) -> Tensor:
    """Return the intensities (N, 1, H, W) with the coarse structure of squares of pixels.

    They are those of the engine (:mod:`jotlight.networks.inference.coarse_scales`).

    Parameters
    ----------
    estimate : callable
        ``estimate(counts, sensor)`` returns the intensities of squares.
    intensity, counts : Tensor, shape (N, 1, H, W)
        The intensities without squares, and L.
    sensor : Sensor
        The sensor, without maps of its jots.
    """
    try:
        fine, ones = _values(intensity), _values(counts)
    except RuntimeError:  # the transforms of torch.func hide the values
        return intensity
    few = [n for n, (each,) in enumerate(fine) if has_few_photons(each, sensor, sensor.trials)]
    if not few:
        return intensity
    squares = sensor_of_squares(sensor)
    coarse = _values(estimate(torch.from_numpy(sum_squares(ones[few])).to(counts.device), squares))
    for index, (each,) in zip(few, coarse, strict=True):
        fine[index, 0] = add_coarse(fine[index, 0], each, squares, squares.trials)
    return torch.from_numpy(fine).to(intensity)


def _values(images: Tensor) -> npt.NDArray[np.float32]:
    return np.asarray(images.float().cpu().numpy(), np.float32)


def _angle(probability: Tensor) -> Tensor:
    """Return arcsin √p, with the derivative near 0 and 1 where it would be infinite there."""
    finite = torch.arcsin(torch.sqrt(probability.clamp(_MIN_PROBABILITY, _MAX_PROBABILITY)))
    exact = torch.arcsin(torch.sqrt(probability.detach().clamp(0, 1)))
    return finite + (exact - finite).detach()
