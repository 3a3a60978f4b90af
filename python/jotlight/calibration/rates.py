"""From counts to detections per frame and back, for any threshold, however many there are."""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.sensing.response import detection_density, detection_probability

Counts = npt.NDArray[np.int32]
Rates = npt.NDArray[np.float64]


def detections(ones: Counts, frames: int, threshold: int) -> Rates:
    """Detections per frame that make L ones of N frames most likely: P⁻¹(q, L/N).

    All N of them would make it infinite; half a one less stands for that.

    Examples
    --------
    >>> detections(np.array([[0, 5, 10]], np.int32), 10, 1).round(3).tolist()
    [[0.0, 0.693, 2.996]]
    """
    different, place = np.unique(ones, return_inverse=True)
    shares = np.minimum(different, frames - 0.5) / frames
    rates = [engine.inverse_detection_probability(threshold, float(share)) for share in shares]
    return np.asarray(rates, np.float64)[place].reshape(ones.shape)


def variance(rates: Rates, frames: int, threshold: int) -> Rates:
    """The variance of :func:`detections` at these rates, to first order; of 1 count for none.

    It is p(1 - p)/N over the square of ∂P/∂s.
    """
    # Below half a count the first order says nothing.
    least = engine.inverse_detection_probability(threshold, 0.5 / frames)
    most = engine.inverse_detection_probability(threshold, 1 - 0.5 / frames)
    s = np.clip(rates, least, most)
    p, density = detection_probability(threshold, s), detection_density(threshold, s)
    return np.asarray(p * (1 - p) / frames / density**2)
