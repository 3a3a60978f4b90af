"""The paper's two-layer network at its initial parameters (section 3.2)."""

import math
import operator

import numpy as np
import numpy.typing as npt

from jotlight.estimators import vst
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.networks.architectures import fit_spline, gaussian_filter
from jotlight.networks.layer import Layer
from jotlight.sensing.sensor import Sensor


def build_two_layer(
    sensor: Sensor, sigma: float, tied: bool, taps: int, coefficients: int, nu: float
) -> list[Layer]:
    """Give the layers; :meth:`jotlight.Network.initial` says what these are."""
    if not (math.isfinite(sigma) and sigma > 0):
        raise ValueError(f"sigma: expected a number above 0, got {sigma}")
    taps, coefficients = operator.index(taps), operator.index(coefficients)
    if taps < 1 or taps % 2 == 0:
        raise ValueError(f"taps: expected an odd number, got {taps}")
    if coefficients < 5:
        raise ValueError(f"coefficients: expected at least 5, got {coefficients}")
    if not (math.isfinite(nu) and nu >= 0):
        raise ValueError(f"nu: expected a number of 0 or more, got {nu}")
    bits = sensor.bits_per_pixel

    from scipy.optimize import isotonic_regression

    low, high = vst.anscombe([0, bits], bits).astype(float)

    def intensity(z: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        counts = vst.inverse_anscombe(z.clip(low, high), bits, inverse="algebraic")
        return intensity_from_probability(counts / np.float32(bits), sensor, None).astype(
            np.float64
        )

    block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)
    first = fit_spline(
        lambda counts: vst.anscombe(counts, bits).astype(np.float64), 0.0, bits, coefficients
    )
    # A spline stays in the hull of its coefficients, so u lies there, and r not far from there.
    least, most = float(first[0].min()), float(first[0].max())
    room = nu * (most - least)
    second = fit_spline(intensity, least - room, most + room, coefficients)
    # At the ends of [0, S] the fit swings a little; more light never gives less.
    rising = isotonic_regression(second[0][0]).x[None].astype(np.float32)
    second = (rising.clip(0, sensor.max_intensity), *second[1:])
    return [
        Layer(np.ones((1, *block), np.float32), *first),
        Layer(gaussian_filter(sigma, taps), *second),
    ]
