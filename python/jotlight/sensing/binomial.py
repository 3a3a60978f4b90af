"""Binomial fractions: the transform after which their noise is the same everywhere.

The fraction of ones among K bits has the variance p (1 - p)/K. The angle z = arcsin √p of a
fraction has nearly the variance 1/(4 K), whatever p is.
"""

from typing import TypeVar

import numpy as np
import numpy.typing as npt

Real = TypeVar("Real", bound=np.floating)


def arcsin_root(fraction: npt.NDArray[Real]) -> npt.NDArray[Real]:
    """Return z = arcsin √p, of the type of p. Fractions are clipped to [0, 1].

    Examples
    --------
    >>> arcsin_root(np.array([0.0, 0.5, 1.0])).round(3).tolist()
    [0.0, 0.785, 1.571]
    """
    return np.asarray(np.arcsin(np.sqrt(np.clip(fraction, 0, 1))))


def squared_sine(z: npt.NDArray[Real]) -> npt.NDArray[Real]:
    """Return p = sin² z, the inverse of :func:`arcsin_root`, of the type of z.

    Examples
    --------
    >>> squared_sine(arcsin_root(np.array([0.0, 0.25, 1.0]))).round(3).tolist()
    [0.0, 0.25, 1.0]
    """
    return np.asarray(np.sin(z) ** 2)
