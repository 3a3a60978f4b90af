"""Maximum likelihood for readings with different gains and thresholds, pixel by pixel."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.layout import join
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.likelihood.joint_likelihood import JointLikelihood, joint_likelihood
from jotlight.sensing.likelihood.joint_term import Term
from jotlight.sensing.likelihood.multibit import ReadingLikelihood
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.parameters.response import intensity_at_probability
from jotlight.sensing.sensor import Sensor
from jotlight.underflow import underflows_to_0


def joint_mle(images: GrayImages, sensor: Sensor, threads: int | None) -> Image:
    """Return the most likely intensity of each pixel, (N, H, W), from readings that may differ.

    Parameters
    ----------
    images : GrayImages
        The data: bits, or counts if they say which readings are 1.
    sensor : Sensor
        The sensor of the data.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float32
        Intensities in [0, S].

    Warns
    -----
    JotlightWarning
        When pixels without a valid bit were inpainted from their neighbors.
    """
    estimates, dead = [], []
    for one in images.data:
        joint = joint_likelihood(one, sensor, threads)
        estimates.append(maximize(joint).astype(np.float32)[None])
        dead.append((joint.trials == 0)[None])
    dead_pixels = np.concatenate(dead)
    return inpaint_dead_pixels(join(estimates), dead_pixels if dead_pixels.any() else None)


def maximize(joint: JointLikelihood) -> Array:
    """Return the intensities in [0, S] at which a joint likelihood is highest, (H, W).

    Notes
    -----
    The engine computes it. The log-likelihood is concave. Newton's method solves for the zero of
    its derivative about v = log(x + δ), where δ is the intensity whose detections equal the dark
    counts: without dark counts, the log-likelihood is concave in v too, and nearly quadratic.
    Steps that leave the known bounds of the maximum are replaced by a bisection of v. A pixel
    without a valid bit is 0.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=2, gain=[0.5, 1.5], max_intensity=9.0)
    >>> bits = jl.Bits.from_array([[[1]], [[0]]])
    >>> maximize(joint_likelihood(bits, sensor, None)).round(4)  # 2 log(4/3)
    array([[0.5754]])
    """
    offset = dark_intensity(joint.sensor)
    return joint.maximum(_start(joint, offset), offset)


def dark_intensity(sensor: Sensor) -> float:
    """Return the intensity that causes as many detections as the dark counts, 0 without these.

    Examples
    --------
    >>> dark_intensity(jl.Sensor(frames=2, gain=[1.0, 3.0], dark_counts=0.5))
    0.25
    """
    efficiency, dark_counts = reference_jot(sensor)
    mean = float(np.mean([group.sensor.light_per_intensity for group in sensor.groups()]))
    return dark_counts / (efficiency * mean)


def _start(joint: JointLikelihood, offset: float) -> Array:
    """Return the mean of the estimates from each group, weighted by their information about v."""
    total, weights = np.zeros(joint.shape), np.zeros(joint.shape)
    for term in joint.terms:
        own, information, trials = _estimate_of_group(term, joint.sensor, offset)
        weight = np.minimum(information * (own + offset) ** 2, trials) + 1e-9 * trials
        logarithm = weight * np.log(own + offset)
        are_cells = term.side == 1
        total += term.sum_pixels(logarithm) if are_cells else logarithm
        weights += term.sum_pixels(weight) if are_cells else weight
    mean = np.divide(total, weights, out=np.zeros(joint.shape), where=weights > 0)
    return np.asarray(np.exp(mean) - offset)


@underflows_to_0
def _estimate_of_group(term: Term, sensor: Sensor, offset: float) -> tuple[Array, Array, Array]:
    """Return the intensity that the readings of a group state, its information, and their number.

    If a pixel has one cell, they are those of the cells. Otherwise the jots of a pixel estimate its
    intensity together, (H, W). Pixels without readings are left out.
    """
    efficiency, dark_counts = reference_jot(sensor)
    cells, highest, slope = term.cells, sensor.max_intensity, efficiency * term.light
    are_pixels = term.side == 1
    pool = np.asarray if are_pixels else term.sum_pixels
    trials = pool(term.trials)
    if isinstance(cells, ReadingLikelihood):
        rate = pool(cells.trials * cells.likely_rate()) / np.maximum(trials, 1)
        own = np.clip((rate - dark_counts) / slope, 1e-9 * highest, highest)
        # That of Poisson counts, as far as the readings are not the largest one.
        unsaturated = 1 - pool(cells.total) / np.maximum(cells.max_reading * trials, 1)
        information = trials * efficiency * term.light * unsaturated / (own + offset)
        return own, information, trials
    p = (pool(term.total) + 0.5) / (trials + 1)
    own = intensity_at_probability(cells.threshold, p, 1 - p, slope, dark_counts)
    own = np.clip(own, 1e-9 * highest, highest)
    light = term.light * own if are_pixels else term.spread(own)
    return own, term.light**2 * pool(cells.information(light)), trials


def regular_maximum(joint: JointLikelihood) -> Array:
    """Return the maximum, where pixels whose readings are all alike are moved inward.

    A pixel with only zeros has the intensity at which half a one is expected, and a pixel with only
    ones that at which half a zero is. So the information at these intensities is finite.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=2, gain=[0.5, 1.5], max_intensity=9.0)
    >>> joint = joint_likelihood(jl.Bits.from_array(np.zeros((2, 1, 1), int)), sensor, None)
    >>> regular_maximum(joint).round(4), maximize(joint)  # 2 - exp(-x/2) - exp(-3x/2) = 1/2
    (array([[0.2988]]), array([[0.]]))
    """
    total, largest = joint.total, joint.max_total
    result = maximize(joint)
    for extreme, count in ((total == 0, 0.5), (total == largest, largest - 0.5)):
        is_moved = extreme & (largest > 0)
        if is_moved.any():
            result = np.where(is_moved, solve_expected_total(joint, count), result)
    return result


def solve_expected_total(joint: JointLikelihood, total: npt.ArrayLike) -> Array:
    """Return the intensity in [0, S] at which a sum of the readings is expected, (H, W).

    For bits, it is a number of ones.

    Examples
    --------
    >>> joint = joint_likelihood(
    ...     jl.Bits.from_array([[[1]], [[0]]]), jl.Sensor(frames=2, threshold=[1, 2]), None
    ... )
    >>> solve_expected_total(joint, 0.5).round(4)
    array([[0.518]])
    """
    wanted = np.broadcast_to(np.asarray(total, np.float64), joint.shape)
    offset = dark_intensity(joint.sensor)
    # The light of the mean reading, if it is the only one.
    number = float(np.max(joint.trials))
    mean = np.mean([term.light for term in joint.terms])
    return joint.solve_expected_total(wanted, (wanted + 0.5) / (number * mean), offset)
