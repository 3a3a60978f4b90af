"""Maximum likelihood for readings with different gains and thresholds, pixel by pixel."""

import numpy as np
import numpy.typing as npt

from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.layout import join
from jotlight.sensing.joint_likelihood import JointLikelihood, joint_likelihood
from jotlight.sensing.pixel_counts import Estimate, GrayImages
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.response import Array, inverse_detection_probability
from jotlight.sensing.sensor import Sensor

_MAX_STEPS = 200
"""Maximum number of steps of Newton's method with bisection. Most pixels need less than ten."""

_TOLERANCE = 1e-9
"""Relative change of the intensity at which the iteration stops. The next step would be about its
square."""

_MAX_RATIO = 1e-6
"""Smallest ratio of the bounds between which a bisection takes place. Smaller values are rare."""


def joint_mle(images: GrayImages, sensor: Sensor, threads: int | None) -> Estimate:
    """Return the most likely intensity of each pixel, from readings that may differ.

    Parameters
    ----------
    images : GrayImages
        The data: bits, or counts if they say which readings are 1.
    sensor : Sensor
        The sensor of the data.
    threads : int, optional
        The number of threads. Default: all cores.

    Returns
    -------
    ndarray of float32
        Intensities in [0, S].

    Warns
    -----
    JotlightWarning
        When pixels without a valid bit were filled from their neighbors.
    """
    estimates, dead = [], []
    for one in images.data:
        joint = joint_likelihood(one, sensor, threads)
        estimates.append(maximize(joint).astype(np.float32)[None])
        dead.append((joint.trials == 0)[None])
    dead_pixels = np.concatenate(dead)
    return images.layout.arrange(
        inpaint_dead_pixels(join(estimates), dead_pixels if dead_pixels.any() else None)
    )


def maximize(joint: JointLikelihood) -> Array:
    """Return the intensities in [0, S] at which a joint likelihood is highest, (H, W).

    Notes
    -----
    The log-likelihood is concave. Newton's method solves for the zero of its derivative about
    v = log(x + δ), where δ is the intensity whose detections equal the dark counts: without dark
    counts, the log-likelihood is concave in v too, and nearly quadratic. Steps that leave the known
    bounds of the maximum are replaced by a bisection of v. A pixel without a valid bit is 0.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> sensor = Sensor(frames=2, gain=[0.5, 1.5], max_intensity=9.0)
    >>> bits = Bits.from_array([[[1]], [[0]]])
    >>> maximize(joint_likelihood(bits, sensor, None)).round(4)  # 2 log(4/3)
    array([[0.5754]])
    """
    highest, offset = joint.sensor.max_intensity, dark_intensity(joint.sensor)
    at_zero = joint.gradient_and_curvature(0.0)[0] <= 0
    at_highest = joint.gradient_and_curvature(highest)[0] >= 0
    inside = ~(at_zero | at_highest)
    low, high = np.zeros(joint.shape), np.full(joint.shape, highest)
    x = np.where(inside, np.clip(_start(joint, offset), 0, highest), highest / 2)
    for _ in range(_MAX_STEPS if inside.any() else 0):
        gradient, curvature = joint.gradient_and_curvature(x)
        rises = gradient > 0
        low, high = np.where(rises, x, low), np.where(gradient < 0, x, high)
        scale = x + offset
        slope = scale * curvature - gradient
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            newton = scale * np.exp(gradient / slope) - offset
        accepted = (slope > 0) & (low < newton) & (newton < high)
        bound = np.maximum(low, _MAX_RATIO * high)
        middle = np.sqrt((bound + offset) * (high + offset)) - offset
        new = np.where(accepted, newton, middle)
        new = np.where(gradient == 0, x, new)
        converged = abs(new - x) <= _TOLERANCE * scale
        x = new
        if converged[inside].all():
            break
    return np.where(at_zero, 0.0, np.where(at_highest, highest, x))


def dark_intensity(sensor: Sensor) -> float:
    """Return the intensity that causes as many detections as the dark counts, 0 without these.

    Examples
    --------
    >>> dark_intensity(Sensor(frames=2, gain=[1.0, 3.0], dark_counts=0.5))
    0.25
    """
    efficiency, dark_counts = reference_jot(sensor)
    mean = float(np.mean([group.sensor.light_per_intensity for group in sensor.groups()]))
    return dark_counts / (efficiency * mean)


def _start(joint: JointLikelihood, offset: float) -> Array:
    """Return the mean of the estimates from each group, weighted by their information about v."""
    efficiency, dark_counts = reference_jot(joint.sensor)
    highest = joint.sensor.max_intensity
    total, weights = np.zeros(joint.shape), np.zeros(joint.shape)
    for term in joint.terms:
        cells = term.cells
        ones = term.sum_pixels(cells.ones.astype(np.float64))
        trials = term.sum_pixels(np.broadcast_to(np.asarray(cells.trials, float), cells.shape))
        fraction = (ones + 0.5) / (trials + 1)
        rate = inverse_detection_probability(cells.threshold, fraction, 1 - fraction)
        own = np.clip((rate - dark_counts) / (efficiency * term.light), 1e-9 * highest, highest)
        light = term.spread(own)
        information = term.light**2 * term.sum_pixels(cells.information(light))
        weight = np.minimum(information * (own + offset) ** 2, trials) + 1e-9 * trials
        total += weight * np.log(own + offset)
        weights += weight
    mean = np.divide(total, weights, out=np.zeros(joint.shape), where=weights > 0)
    return np.asarray(np.exp(mean) - offset)


def regular_maximum(joint: JointLikelihood) -> Array:
    """Return the maximum, where pixels whose readings are all alike are moved inward.

    A pixel with only zeros has the intensity at which half a one is expected, and a pixel with only
    ones that at which half a zero is. So the information at these intensities is finite.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> sensor = Sensor(frames=2, gain=[0.5, 1.5], max_intensity=9.0)
    >>> joint = joint_likelihood(Bits.from_array(np.zeros((2, 1, 1), int)), sensor, None)
    >>> regular_maximum(joint).round(4), maximize(joint)  # 2 - exp(-x/2) - exp(-3x/2) = 1/2
    (array([[0.2988]]), array([[0.]]))
    """
    ones, trials = joint.ones, joint.trials
    result = maximize(joint)
    for extreme, count in ((ones == 0, 0.5), (ones == trials, trials - 0.5)):
        is_moved = extreme & (trials > 0)
        if is_moved.any():
            result = np.where(is_moved, solve_expected_ones(joint, count), result)
    return result


def solve_expected_ones(joint: JointLikelihood, ones: npt.ArrayLike) -> Array:
    """Return the intensity in [0, S] at which a number of ones is expected, (H, W), by bisection.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> joint = joint_likelihood(
    ...     Bits.from_array([[[1]], [[0]]]), Sensor(frames=2, threshold=[1, 2]), None
    ... )
    >>> solve_expected_ones(joint, 0.5).round(4)
    array([[0.518]])
    """
    wanted = np.asarray(ones, np.float64)
    uniform = joint.uniform
    if uniform:
        # All pixels with the same count have the same solution.
        distinct, places = np.unique(np.broadcast_to(wanted, joint.shape), return_inverse=True)
        wanted = distinct
    else:
        wanted = np.broadcast_to(wanted, joint.shape)
    solution = bisect_intensity(joint, wanted)
    return solution[places].reshape(joint.shape) if uniform else solution


def bisect_intensity(joint: JointLikelihood, wanted: Array) -> Array:
    """Return the intensities in [0, S] at which `wanted` ones are expected, of the same shape.

    The shape is (H, W), or any shape if the pixels are uniform.
    """
    highest, offset = joint.sensor.max_intensity, dark_intensity(joint.sensor)
    low, high = np.zeros(wanted.shape), np.full(wanted.shape, highest)
    for _ in range(_MAX_STEPS):
        bound = np.maximum(low, _MAX_RATIO * high)
        middle = np.sqrt((bound + offset) * (high + offset)) - offset
        below = joint.expected_ones(middle) < wanted
        low, high = np.where(below, middle, low), np.where(below, high, middle)
        if (high - low <= 1e-12 * high).all() or high.max() <= 1e-15 * highest:
            break
    outside = joint.expected_ones(np.zeros(wanted.shape)) >= wanted
    return np.where(outside, 0.0, high)
