"""Checks of the estimate that a caller knows already."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.checks import refuse_masked


def read_estimate(
    estimate: npt.ArrayLike, shape: tuple[int, ...], max_intensity: float | npt.NDArray[np.floating]
) -> Image:
    """Return an estimate that a caller states, limited to the range of intensities.

    Methods may exceed the range a little. An estimate whose mean is outside has other units.

    Parameters
    ----------
    estimate : array_like of float
        The estimate, in units of intensity.
    shape : tuple of int
        The shape of the estimates of the data.
    max_intensity : float or ndarray
        S, the largest intensity: a number, or one for each color.

    Raises
    ------
    TypeError, ValueError
        When the estimate does not fit the data, is not finite, or has other units.

    Examples
    --------
    >>> read_estimate([[0.5, 1.01]], (1, 2), 1.0).tolist()
    [[0.5, 1.0]]
    >>> read_estimate([[127, 255]], (1, 2), 1.0)
    Traceback (most recent call last):
      ...
    ValueError: estimate: expected intensities from 0 to 1, got a mean of 191; ...
    """
    refuse_masked("estimate", estimate)
    values = np.asarray(estimate)
    if values.dtype.kind not in "fiu":
        raise TypeError(f"estimate: expected an array of float, got {values.dtype}")
    if values.shape != shape:
        raise ValueError(
            f"estimate: expected shape {shape}, got {values.shape}; pass what "
            "jotlight.reconstruct returns for the same data"
        )
    if not np.isfinite(values).all():
        raise ValueError("estimate: expected finite intensities, got infinity or NaN")
    mean, largest = float(values.mean(dtype=np.float64)), float(np.max(max_intensity))
    if values.size and not 0 <= mean <= largest:
        raise ValueError(
            f"estimate: expected intensities from 0 to {largest:g}, got a mean of {mean:.3g}; pass "
            "what jotlight.reconstruct returns for the same data, in units of intensity"
        )
    return np.clip(values.astype(np.float32), 0, np.asarray(max_intensity, np.float32))
