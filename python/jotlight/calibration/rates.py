"""From counts to detections per frame, for any threshold."""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import Counts
from jotlight.interrupts import interruptible
from jotlight.sensing.response import detection_density, detection_probability

Rates = npt.NDArray[np.float64]


def detections(ones: Counts, frames: int, threshold: int) -> Rates:
    """Return the most likely detections per frame of each jot: P⁻¹(q, L/N).

    For L = N, they would be infinite, so N - 1/2 replaces L.

    Examples
    --------
    >>> detections(np.array([[0, 5, 10]], np.int32), 10, 1).round(3).tolist()
    [[0.0, 0.693, 2.996]]
    """
    unique, index = interruptible(np.unique)(ones, return_inverse=True)
    fractions = np.minimum(unique, frames - 0.5) / frames
    rates = [
        engine.inverse_detection_probability(threshold, float(fraction)) for fraction in fractions
    ]
    return np.asarray(rates, np.float64)[index].reshape(ones.shape)


def variance(rates: Rates, frames: int, threshold: int) -> Rates:
    """Return the variance of :func:`detections` at these rates, to first order.

    It is p(1 - p)/N divided by the square of ∂P/∂s. Rates are clipped to those of 1/2 and N - 1/2
    counts.
    """
    low = engine.inverse_detection_probability(threshold, 0.5 / frames)
    high = engine.inverse_detection_probability(threshold, 1 - 0.5 / frames)
    s = np.clip(rates, low, high)
    p = detection_probability(threshold, s)
    return np.asarray(p * (1 - p) / frames / detection_density(threshold, s) ** 2)
