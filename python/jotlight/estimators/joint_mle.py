"""Maximum likelihood for readings with different gains and thresholds, pixel by pixel."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.layout import join
from jotlight.sensing.joint_likelihood import JointLikelihood, joint_likelihood
from jotlight.sensing.multibit import ReadingLikelihood
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

    def evaluate(intensity: Array) -> tuple[Array, Array]:
        gradient, curvature = joint.gradient_and_curvature(intensity)
        return gradient, (intensity + offset) * curvature - gradient

    inside = ~(at_zero | at_highest)
    x = _find_root(evaluate, _start(joint, offset), inside, highest, offset)
    return np.where(at_zero, 0.0, np.where(at_highest, highest, x))


def _find_root(
    evaluate: Callable[[Array], tuple[Array, Array]],
    start: Array,
    inside: npt.NDArray[np.bool_],
    highest: float,
    offset: float,
) -> Array:
    """Return the intensities at which a function is 0, by Newton's method with bisection.

    Parameters
    ----------
    evaluate : callable
        It returns the function, which falls, and minus its derivative about v = log(x + offset).
    start : ndarray
        The first intensities.
    inside : ndarray of bool
        Where the function is above 0 at 0, and below 0 at `highest`. Others have no result.
    highest, offset : float
        The highest intensity, and δ.
    """
    low, high = np.zeros(start.shape), np.full(start.shape, highest)
    x = np.where(inside, np.clip(start, 0, highest), highest / 2)
    for _ in range(_MAX_STEPS if inside.any() else 0):
        value, slope = evaluate(x)
        low, high = np.where(value > 0, x, low), np.where(value < 0, x, high)
        scale = x + offset
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            newton = scale * np.exp(value / slope) - offset
            # Rounding can move a last tiny step across a bound, where bisection would undo it.
            converged = (slope > 0) & (abs(newton - x) <= _TOLERANCE * scale)
        accepted = (slope > 0) & (low < newton) & (newton < high)
        bound = np.maximum(low, _MAX_RATIO * high)
        middle = np.sqrt((bound + offset) * (high + offset)) - offset
        x = np.where(converged, x, np.where(accepted, newton, middle))
        if (converged | (high - low <= _TOLERANCE * scale))[inside].all():
            break
    return x


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
        cells, are_pixels = term.cells, term.side == 1
        # Jots of a pixel estimate its intensity together. Pixels without readings are left out.
        pool = np.asarray if are_pixels else term.sum_pixels
        trials = pool(term.trials)
        if isinstance(cells, ReadingLikelihood):
            rate = pool(cells.trials * cells.likely_rate()) / np.maximum(trials, 1)
        else:
            fraction = (pool(term.total) + 0.5) / (trials + 1)
            rate = inverse_detection_probability(cells.threshold, fraction, 1 - fraction)
        own = np.clip((rate - dark_counts) / (efficiency * term.light), 1e-9 * highest, highest)
        light = term.light * own if are_pixels else term.spread(own)
        information = term.light**2 * pool(cells.information(light))
        weight = np.minimum(information * (own + offset) ** 2, trials) + 1e-9 * trials
        logarithm = weight * np.log(own + offset)
        total += term.sum_pixels(logarithm) if are_pixels else logarithm
        weights += term.sum_pixels(weight) if are_pixels else weight
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
    >>> from jotlight.sensing.bits import Bits
    >>> joint = joint_likelihood(
    ...     Bits.from_array([[[1]], [[0]]]), Sensor(frames=2, threshold=[1, 2]), None
    ... )
    >>> solve_expected_total(joint, 0.5).round(4)
    array([[0.518]])
    """
    wanted = np.asarray(total, np.float64)
    uniform = joint.uniform
    if uniform:
        # All pixels with the same count have the same solution.
        distinct, places = np.unique(np.broadcast_to(wanted, joint.shape), return_inverse=True)
        wanted = distinct
    else:
        wanted = np.broadcast_to(wanted, joint.shape)
    highest, offset = joint.sensor.max_intensity, dark_intensity(joint.sensor)

    def evaluate(intensity: Array) -> tuple[Array, Array]:
        expected, slope, _ = joint.expected_total(intensity)
        return wanted - expected, (intensity + offset) * slope

    at_zero = joint.expected_total(np.zeros(wanted.shape))[0] >= wanted
    at_highest = joint.expected_total(np.full(wanted.shape, highest))[0] <= wanted
    inside = ~(at_zero | at_highest)
    # The light of the mean reading, if it is the only one.
    number = float(np.max(joint.trials))
    mean = np.mean([term.light for term in joint.terms])
    x = _find_root(evaluate, (wanted + 0.5) / (number * mean), inside, highest, offset)
    solution = np.where(at_zero, 0.0, np.where(at_highest, highest, x))
    return solution[places].reshape(joint.shape) if uniform else solution
