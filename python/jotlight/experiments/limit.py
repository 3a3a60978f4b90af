"""The least mean square error that any estimator can have on the synthetic scenes."""

import math

import numpy as np
from scipy.special import comb


def posterior_mean_psnr(bits_per_pixel: int, *, nodes: int = 400) -> float:
    """PSNR of the posterior mean, for intensities uniform in [0, 1] and independent, α = K, q = 1.

    The count L of a pixel's ones has the binomial distribution with K bits and probability
    1 - e^-c, and carries all that the bits know of c. So the least mean square error is
    E[c²] - Σ_L P(L) E[c | L]², and its integrals over c are found by Gauss-Legendre quadrature.

    Parameters
    ----------
    bits_per_pixel : int
        K, up to 1000.
    nodes : int
        Of the quadrature.

    Returns
    -------
    float
        10 log10(1 / least mean square error), in dB.

    Examples
    --------
    >>> round(posterior_mean_psnr(9), 3)
    14.816
    """
    if not 1 <= bits_per_pixel <= 1000:
        raise ValueError(f"bits_per_pixel: expected 1 to 1000, got {bits_per_pixel}")
    x, weights = np.polynomial.legendre.leggauss(nodes)
    c, weights = (x + 1) / 2, weights / 2
    ones = np.arange(bits_per_pixel + 1)[:, None]
    probability = (
        comb(bits_per_pixel, ones) * (-np.expm1(-c)) ** ones * np.exp(-c * (bits_per_pixel - ones))
    )
    evidence = probability @ weights
    mean = probability @ (weights * c) / evidence
    error = 1 / 3 - float(evidence @ mean**2)
    return -10 * math.log10(error)
