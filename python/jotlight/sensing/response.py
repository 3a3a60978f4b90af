"""The response of a pixel's jots, P(q, s), in double precision and with its complement.

The engine solves the same equations for pictures; here they are for single numbers and tables,
where what is near to 1 must keep its digits.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.sensing.sensor import Sensor

Array = npt.NDArray[np.float64]


def light_per_intensity(sensor: Sensor) -> float:
    """α/K: photons per jot and frame at intensity 1, with the box kernel."""
    return sensor._gain / sensor.bits_per_pixel


def detection_probability(threshold: int, rate: npt.ArrayLike) -> Array:
    """P(q, s) of a jot that detects s photons per frame in the mean.

    Examples
    --------
    >>> detection_probability(1, [0.0, 1.0]).round(4).tolist()
    [0.0, 0.6321]
    """
    if threshold == 1:  # some twenty times as fast
        return np.asarray(-np.expm1(-np.asarray(rate, np.float64)))
    from scipy.special import gammainc

    return np.asarray(gammainc(threshold, np.asarray(rate, np.float64)))


def detection_density(threshold: int, rate: npt.ArrayLike) -> Array:
    """∂P/∂s = s^(q - 1) exp(-s) / (q - 1)!.

    Examples
    --------
    >>> detection_density(2, 1.0).round(4).tolist()
    0.3679
    """
    from scipy.special import gammaln, xlogy

    s = np.asarray(rate, np.float64)
    if threshold == 1:
        return np.asarray(np.exp(-s))
    return np.asarray(np.exp(xlogy(threshold - 1, s) - s - gammaln(threshold)))


def inverse_detection_probability(
    threshold: int, probability: npt.ArrayLike, complement: npt.ArrayLike
) -> Array:
    """P⁻¹(q, p), from p and 1 - p, of which the smaller one counts.

    Examples
    --------
    >>> inverse_detection_probability(1, [0.5, 1.0], [0.5, 1e-20]).round(4).tolist()
    [0.6931, 46.0517]
    """
    p, rest = np.asarray(probability, np.float64), np.asarray(complement, np.float64)
    if threshold == 1:
        # As below, without importing SciPy; no finite light gives p = 1.
        with np.errstate(divide="ignore"):
            small, large = -np.log1p(-np.minimum(p, 0.5)), -np.log(np.minimum(rest, 0.5))
        return np.asarray(np.where(p < rest, small, large))
    from scipy.special import gammainccinv, gammaincinv

    return np.asarray(
        np.where(
            p < rest,
            gammaincinv(threshold, np.minimum(p, 0.5)),
            gammainccinv(threshold, np.minimum(rest, 0.5)),
        )
    )


def saturation_intensity(sensor: Sensor) -> float:
    """Give the S that clips no pixel but those all of whose bits are 1.

    It is the intensity of half a count less than all, of the jots that need most light for it: so
    an estimate of one count less is below S, and what is saturated, of which no estimate is
    finite, becomes S.

    Examples
    --------
    >>> round(saturation_intensity(Sensor(frames=16)), 4)  # log(2 * 16)
    3.4657
    """

    def least(value: Any) -> float:
        if not isinstance(value, np.ndarray):
            return float(value)
        living = value if sensor.mask is None or sensor.mask.all() else value[~sensor.mask]
        return float(living.min())

    half = 0.5 / sensor.bits_per_pixel
    rate = float(inverse_detection_probability(sensor.threshold, 1 - half, half))
    light = max(rate - least(sensor.dark_counts), 0.0) / least(sensor.efficiency)
    return light / light_per_intensity(sensor) or 1.0
