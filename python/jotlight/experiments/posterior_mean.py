"""The lowest mean square error that any estimator can reach on the synthetic scenes."""

import math

import numpy as np
from scipy.special import comb

from jotlight.sensing.parameters.response import detection_probability


def posterior_mean_psnr(trials: int, *, nodes: int = 400) -> float:
    """Return the PSNR of the posterior mean on the paper's synthetic scenes.

    The intensities c are independent and uniform in [0, 1], α = K, q = 1. The count L of a
    pixel's ones is binomial with K trials and probability 1 - e^-c, and it holds everything that
    the bits say about c. The lowest mean square error is therefore
    E[c²] - Σ_L P(L) E[c | L]². Gauss-Legendre quadrature computes the integrals over c.

    Parameters
    ----------
    trials : int
        K, from 1 to 1000.
    nodes : int
        Number of nodes of the quadrature.

    Returns
    -------
    float
        10 log10(1 / lowest mean square error), in dB.

    Raises
    ------
    ValueError
        If `trials` is out of range.

    Examples
    --------
    >>> round(posterior_mean_psnr(9), 3)
    14.816
    """
    if not 1 <= trials <= 1000:
        raise ValueError(f"trials: expected 1 to 1000, got {trials}")
    x, weights = np.polynomial.legendre.leggauss(nodes)
    c, weights = (x + 1) / 2, weights / 2
    ones = np.arange(trials + 1)[:, None]
    probability = (
        comb(trials, ones) * detection_probability(1, c) ** ones * np.exp(-c * (trials - ones))
    )
    evidence = probability @ weights
    mean = probability @ (weights * c) / evidence
    error = 1 / 3 - float(evidence @ mean**2)
    return -10 * math.log10(error)
