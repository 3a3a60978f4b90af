"""Gated captures: counts per gate, without the pile-up of one-bit readings, and lifetimes."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import number_in_range, positive_number, shown
from jotlight.errors import import_extra
from jotlight.sensing.response import Array
from jotlight.sensing.values import numbers_from_zero


def gate_detections(
    counts: npt.ArrayLike,
    trials: npt.ArrayLike,
    *,
    first_photon: bool = False,
    dark_counts: float = 0.0,
) -> tuple[Array, Array]:
    """Return the expected detections per gate and reading, without pile-up, and standard errors.

    A reading of one bit reports one photon of several, so ones are fewer than photons. With the
    fraction L/n of ones, the expected number is -log(1 - L/n), exactly.

    Parameters
    ----------
    counts : array_like of int, shape (G, ...)
        L: the number of ones of each gate, and of each pixel.
    trials : int or array_like of int, shape (G,) or that of the counts
        n: the number of readings of each gate; or of cycles, with `first_photon`.
    first_photon : bool
        Whether each cycle of the laser passes all gates in order, and only its first photon is
        recorded, as in time-correlated counting. A gate then sees only the cycles without an
        earlier photon (Coates 1968). Default: each gate has readings of its own.
    dark_counts : float
        d: the expected detections per gate and reading without light, which are subtracted.

    Returns
    -------
    detections, standard_error : ndarray of float64, shape (G, ...)
        Detections are 0 or more. They are infinite for a gate whose readings are all ones, and NaN
        for a gate without readings.

    Raises
    ------
    ValueError
        When the numbers are out of range, or a count exceeds its readings.

    Examples
    --------
    >>> detections, error = gate_detections([[500], [250]], 1000)
    >>> detections.round(4).tolist(), error.round(4).tolist()  # log(2) and log(4/3)
    ([[0.6931], [0.2877]], [[0.0316], [0.0183]])
    >>> gate_detections([[500], [250]], 1000, first_photon=True)[0].round(4).tolist()
    [[0.6931], [0.6931]]
    """
    ones = numbers_from_zero("counts", counts)
    if ones.ndim < 1 or (ones != np.floor(ones)).any():
        raise ValueError(f"counts: expected whole numbers (G, ...), got shape {ones.shape}")
    readings = _of_each_count(numbers_from_zero("trials", trials), ones.shape)
    if first_photon:
        # The cycles without a photon in an earlier gate.
        readings[1:] -= ones.cumsum(axis=0)[:-1]
    if (ones > readings).any():
        what = "cycles in all gates together" if first_photon else "readings"
        raise ValueError(f"counts: expected at most the number of {what}, got more ones")
    dark = number_in_range("dark_counts", dark_counts, 0, 1e6)
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = ones / readings
        detections = -np.log1p(-fraction)
        error = np.sqrt(fraction / (1 - fraction) / readings)
    return np.maximum(detections - dark, 0), error


def _of_each_count(trials: Array, shape: tuple[int, ...]) -> Array:
    """Return the readings behind each count, from one number, one for each gate, or all of them."""
    if trials.shape == shape[:1]:
        trials = trials.reshape(-1, *[1] * (len(shape) - 1))
    try:
        return np.broadcast_to(trials, shape).copy()
    except ValueError:
        raise ValueError(
            f"trials: expected one number, one for each of the {shape[0]} gates, or an array of "
            f"shape {shape}, got shape {trials.shape}"
        ) from None


def decay_lifetime(detections: npt.ArrayLike, gate_times: npt.ArrayLike) -> Array:
    """Return the lifetime of the decay of each pixel: that of the best straight line in logarithms.

    Parameters
    ----------
    detections : array_like of float, shape (G, ...)
        Expected detections of gates of equal width.
    gate_times : array_like of float, shape (G,)
        The beginning of each gate, in any unit.

    Returns
    -------
    ndarray of float64, shape (...)
        The lifetimes in the unit of the times; NaN where fewer than two gates have detections, or
        detections do not decay.

    Notes
    -----
    Gates are weighted by their detections, the inverse variance of the logarithm of a count. Gates
    of equal width do not change the slope of a single exponential decay.

    Examples
    --------
    >>> times = np.arange(8) * 0.5
    >>> decay_lifetime(np.exp(-times / 2.5), times).round(6).tolist()
    2.5
    """
    values, times = np.asarray(detections, np.float64), np.asarray(gate_times, np.float64)
    if times.ndim != 1 or len(times) < 2 or values.shape[:1] != times.shape:
        raise ValueError(
            f"gate_times: expected the time of each gate, (G,) with G of 2 or more, got shape "
            f"{times.shape} for detections of shape {values.shape}"
        )
    x = times.reshape(-1, *[1] * (values.ndim - 1))
    usable = np.isfinite(values) & (values > 0)
    weights = np.where(usable, values, 0.0)
    logarithms = np.log(np.where(usable, values, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        total = weights.sum(axis=0)
        mean_x = (weights * x).sum(axis=0) / total
        mean_y = (weights * logarithms).sum(axis=0) / total
        slope = (weights * (x - mean_x) * (logarithms - mean_y)).sum(axis=0)
        slope /= (weights * (x - mean_x) ** 2).sum(axis=0)
        return np.asarray(np.where(slope < 0, -1 / slope, np.nan))


def gate_dataset(
    counts: npt.ArrayLike,
    trials: npt.ArrayLike,
    *,
    gate_times: npt.ArrayLike,
    first_photon: bool = False,
    dark_counts: float = 0.0,
    frequency: float | None = None,
) -> Any:
    """Return a gate stack without pile-up as an `xarray.Dataset` (extra `lifetime`).

    Parameters
    ----------
    counts : array_like of int, shape (G, H, W)
        The number of ones of each gate.
    trials, first_photon, dark_counts
        See :func:`gate_detections`.
    gate_times : array_like of float, shape (G,)
        The beginning of each gate in nanoseconds, which rises.
    frequency : float, optional
        The frequency of the laser in MHz, which programs for phasors need. Default: unknown.

    Returns
    -------
    xarray.Dataset
        The variables `detections`, `standard_error`, and `counts` with the dimensions H (the
        gates), Y, and X, as phasorpy and other packages name them, and `lifetime` with Y and X, in
        nanoseconds. The coordinate H holds the times.

    Raises
    ------
    MissingExtraError
        When xarray is not installed.
    ValueError
        When the arrays do not fit together.
    """
    xarray = import_extra("xarray", "lifetime", "gate stacks as data sets")
    ones = np.asarray(counts)
    times = np.asarray(gate_times, np.float64)
    if ones.ndim != 3:
        raise ValueError(f"counts: expected shape (G, H, W), got {ones.shape}")
    if times.shape != ones.shape[:1]:
        raise ValueError(
            f"gate_times: expected {len(ones)} times, one for each gate, got shape {times.shape}"
        )
    if not (np.diff(times) > 0).all():
        raise ValueError(
            f"gate_times: expected increasing times, got {shown(times)}; sort the gates by time"
        )
    detections, error = gate_detections(
        ones, trials, first_photon=first_photon, dark_counts=dark_counts
    )
    dimensions = ("H", "Y", "X")
    attributes = {} if frequency is None else {"frequency": positive_number("frequency", frequency)}
    return xarray.Dataset(
        {
            "detections": (dimensions, detections, {"units": "per gate and reading"}),
            "standard_error": (dimensions, error, {"units": "per gate and reading"}),
            "counts": (dimensions, ones),
            "lifetime": (dimensions[1:], decay_lifetime(detections, times), {"units": "ns"}),
        },
        coords={"H": ("H", times, {"units": "ns", "long_name": "beginning of the gate"})},
        attrs=attributes,
    )
