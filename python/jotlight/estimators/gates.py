"""Gated captures: counts per gate, without the pile-up of one-bit readings, and lifetimes.

:func:`gate_detections` corrects pile-up, :func:`decay_lifetime` finds the lifetime of a decay, and
:func:`gate_dataset` returns the gates for other packages.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import (
    positive_number,
    refuse_masked,
    shown,
    to_array,
    type_of,
)
from jotlight.errors import import_extra
from jotlight.estimators.photon_counters.decays import TOLERANCE, Gates, decay_rates
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.values import numbers_from_zero

__all__ = ["decay_lifetime", "gate_dataset", "gate_detections"]


def __dir__() -> list[str]:
    return __all__


_MIN_STEP = 1e-12
"""Smallest step between the times of gates, as a fraction of their span."""

_MAX_DARK_COUNTS = 1e6
"""Largest dark counts per gate and reading."""

_MAX_SPAN = 1e300
"""Largest span of the times of gates. Their lifetimes are finite numbers, too."""


def gate_detections(
    counts: npt.ArrayLike,
    trials: npt.ArrayLike,
    *,
    first_photon: bool = False,
    dark_counts: npt.ArrayLike = 0.0,
) -> tuple[Array, Array]:
    """Return the expected detections per gate and reading, without pile-up, and standard errors.

    A reading of one bit reports one photon of several, so ones are fewer than photons. With the
    fraction L/n of ones, the expected number is -log(1 - L/n), exactly.

    Parameters
    ----------
    counts : array_like of int or bool, shape (G, ...)
        L: the number of ones of each gate, and of each pixel. Single bits are counts of 1 reading.
    trials : int or array_like of int
        n: the number of readings, or of cycles with `first_photon`; a number, one for each gate
        (G,), a map of the pixels (H, W), or one for each count. Counts with 0 trials are left out.
    first_photon : bool
        Whether each cycle of the laser passes all gates in order, and only its first photon is
        recorded, as in time-correlated counting. A gate then sees only the cycles without an
        earlier photon (Coates 1968). Default: each gate has readings of its own.
    dark_counts : float or array_like of float
        d: the expected detections per gate and reading without light, which are subtracted, of the
        same shapes as the trials.

    Returns
    -------
    detections, standard_error : ndarray of float64, shape (G, ...)
        Detections are -d or more: noise makes them negative where there is little light, and
        averages over pixels have no bias from dark counts because of that. They are infinite for
        a gate whose readings are all ones, and NaN for a gate without readings. The standard
        error is the one at L/n. So it is 0 for a gate without ones, which is not certain to be
        dark: do not weight gates by 1/error².

    Raises
    ------
    TypeError
        For masked arrays.
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
    ones, readings = _ones_and_readings(counts, trials, first_photon)
    dark = _of_each_count("dark_counts", _checked_dark_counts(dark_counts), ones.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = ones / readings
        detections = -np.log1p(-fraction)
        error = np.sqrt(fraction / (1 - fraction) / readings)
    return detections - dark, error


def _ones_and_readings(
    counts: npt.ArrayLike, trials: npt.ArrayLike, first_photon: bool
) -> tuple[Array, Array]:
    """Return the ones of each gate, and the readings behind them, of shape (G, ...)."""
    ones = numbers_from_zero("counts", _plain_counts(counts))
    is_fraction = ones != np.floor(ones)
    if is_fraction.any():
        raise ValueError(
            f"counts: expected whole numbers, got {ones[is_fraction][0]:g}; pass the number of "
            "ones of each gate"
        )
    refuse_masked("trials", trials, "fill it with 0: such counts are left out")
    readings = _of_each_count("trials", numbers_from_zero("trials", trials), ones.shape).copy()
    if first_photon:
        # The cycles without a photon in an earlier gate.
        readings[1:] -= ones.cumsum(axis=0)[:-1]
    if (ones > readings).any():
        what = "cycles in all gates together" if first_photon else "readings"
        raise ValueError(f"counts: expected at most the number of {what}, got more ones")
    return ones, readings


def _plain_counts(counts: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return the counts of each gate as an array (G, ...), with single bits as 0 and 1."""
    refuse_masked("counts", counts, "fill it with 0, and pass trials of 0 where it is masked")
    array = counts.to_array() if isinstance(counts, Bits) else to_array("counts", counts)
    if array.ndim < 1:
        raise ValueError(f"counts: expected those of each gate (G, ...), got {shown(counts)}")
    return array.astype(np.uint8) if array.dtype == np.bool_ else array


def _checked_dark_counts(dark_counts: npt.ArrayLike) -> Array:
    """Return dark counts in range as float64."""
    refuse_masked("dark_counts", dark_counts, "fill it with numbers, such as its median")
    dark = numbers_from_zero("dark_counts", dark_counts)
    if (dark > _MAX_DARK_COUNTS).any():
        raise ValueError(
            f"dark_counts: expected at most {_MAX_DARK_COUNTS:g} per gate and reading, got "
            f"{dark.max():g}"
        )
    return dark


def _of_each_count(name: str, values: Array, shape: tuple[int, ...]) -> Array:
    """Return the value of each count, as a view of a number, of gates (G,), or of a map (H, W).

    A map has two axes or more: a list may belong only to gates.
    """
    if values.ndim and values.shape == shape[:1]:
        values = values.reshape(-1, *[1] * (len(shape) - 1))
    elif values.ndim and values.shape != shape and (values.ndim < 2 or values.shape != shape[1:]):
        pixels = f"a map of shape {shape[1:]}, " if len(shape) > 2 else ""
        raise ValueError(
            f"{name}: expected one number, one for each of the {shape[0]} gates, {pixels}or an "
            f"array of shape {shape}, got shape {values.shape}"
        )
    return np.broadcast_to(values, shape)


def decay_lifetime(
    detections: npt.ArrayLike,
    gate_times: npt.ArrayLike,
    *,
    trials: npt.ArrayLike | None = None,
    first_photon: bool = False,
    dark_counts: npt.ArrayLike = 0.0,
) -> Array:
    """Return the most likely lifetime of a single exponential decay, for each pixel.

    Pass counts of ones with their `trials`, if you have them: their likelihood contains pile-up,
    dark counts, and gates of ones only.

    Parameters
    ----------
    detections : array_like of float, shape (G, ...)
        With `trials`, L: the number of ones. Otherwise numbers of photons, or expected detections
        of :func:`gate_detections`, which may be negative; those that are not finite are left out.
        The gates need equal widths.
    gate_times : array_like of float, shape (G,)
        The beginning of each gate, in any unit. They rise, in steps of at least 1e-12 of
        their span.
    trials, first_photon, dark_counts
        See :func:`gate_detections`. Default of the trials: `detections` are no counts of ones.

    Returns
    -------
    ndarray of float64, shape (...)
        The lifetimes in the unit of the times; NaN where fewer than two gates have detections,
        detections do not decay or their sum is not above 0, or no finite lifetime above 0 is the
        most likely one.

    Raises
    ------
    TypeError
        For masked arrays.
    ValueError
        When the arrays do not fit together, or hold no numbers, or these are out of range.

    Notes
    -----
    A gate at the time t expects λ = A exp(-t/τ) + d detections per reading, and a reading is 1
    with the probability 1 - exp(-λ). Newton's method finds the A and τ that maximize the binomial
    likelihood, or the Poisson likelihood of photons, which is its limit for many readings. Its
    formula also takes negative detections: the A and τ at its only maximum have the same sums of λ
    and t λ as the detections. Dark counts may cause several maxima. The search then begins at the
    most likely of some lifetimes, each with an A of its own, so it rarely ends at a lower maximum.

    A pixel with few ones often does not decay by chance. The median of the other lifetimes is then
    too short: first add the counts of neighboring pixels, and their trials.

    Examples
    --------
    >>> times = np.arange(8) * 0.5
    >>> decay_lifetime(np.exp(-times / 2.5), times).round(6).tolist()
    2.5
    >>> ones = np.rint(1000 * -np.expm1(-np.exp(-times / 2.5) - 0.1))
    >>> decay_lifetime(ones, times, trials=1000, dark_counts=0.1).round(1).tolist()
    2.5
    """
    dark = _checked_dark_counts(dark_counts)
    if trials is None:
        if first_photon or dark.any():
            raise ValueError(
                "trials: expected the number of readings, which first_photon and dark_counts "
                "need, got None; pass counts of ones and their trials"
            )
        ones, readings = _photons(detections)
    else:
        ones, readings = _ones_and_readings(detections, trials, first_photon)
    times = _rising_times(gate_times, ones.shape)
    span = times[-1] - times[0]
    dark = _of_each_count("dark_counts", dark, ones.shape)
    flat = [each.reshape(len(times), -1) for each in (ones, readings, dark)]
    gates = Gates(flat[0], flat[1], (times - times[0]) / span, flat[2])
    rates = decay_rates(gates).reshape(ones.shape[1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(rates > TOLERANCE, span / rates, np.nan))


def _photons(detections: npt.ArrayLike) -> tuple[Array, Array]:
    """Return numbers of photons as ones, and as many readings that there is no pile-up.

    Numbers that are not finite get no readings.
    """
    values = _real_numbers("detections", detections, "fill it with NaN: such gates are left out")
    usable = np.isfinite(values)
    photons = np.where(usable, values, 0.0)
    return photons, np.where(usable, 2.0**40 * (np.abs(photons).max(initial=0.0) or 1.0), 0.0)


def _real_numbers(name: str, values: npt.ArrayLike, advice: str) -> Array:
    """Return an array of real numbers as float64. The advice is for a masked array."""
    refuse_masked(name, values, advice)
    array = to_array(name, values)
    if array.dtype.kind not in "iuf":
        raise ValueError(
            f"{name}: expected an array of real numbers, got {type_of(values, array)}; cast it "
            "with astype(float)"
        )
    return np.asarray(array, np.float64)


def _rising_times(gate_times: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return the time of each gate as float64, (G,)."""
    times = _real_numbers("gate_times", gate_times, "leave out the gates without a time")
    if times.shape != shape[:1] or len(times) < 2:
        raise ValueError(
            "gate_times: expected the time of each gate, (G,) with G of 2 or more, got shape "
            f"{times.shape} for an array of shape {shape}"
        )
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise ValueError(
            f"gate_times: expected finite, increasing times, got {shown(times)}; sort the gates by "
            "time"
        )
    with np.errstate(over="ignore"):
        span, step = times[-1] - times[0], np.diff(times).min()
    if span > _MAX_SPAN or step < _MIN_STEP * span:
        raise ValueError(
            f"gate_times: expected a span of at most {_MAX_SPAN:g}, and steps of at least "
            f"{_MIN_STEP:g} of it, got a span of {span:g} and a step of {step:g}; use a larger "
            "unit, and merge gates that begin together"
        )
    return times


def gate_dataset(
    counts: npt.ArrayLike,
    trials: npt.ArrayLike,
    *,
    gate_times: npt.ArrayLike,
    first_photon: bool = False,
    dark_counts: npt.ArrayLike = 0.0,
    frequency: float | None = None,
) -> Any:
    """Return a gate stack without pile-up as an `xarray.Dataset` (extra `lifetime`).

    Parameters
    ----------
    counts : array_like of int or bool, shape (G, H, W)
        The number of ones of each gate. For lifetimes, the gates need equal widths.
    trials, first_photon, dark_counts
        See :func:`gate_detections`.
    gate_times : array_like of float, shape (G,)
        The beginning of each gate in nanoseconds, which rises.
    frequency : float, optional
        The frequency of the laser in MHz, which programs for phasors need. It is an attribute of
        the data set and of its `detections`. Default: unknown.

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
    TypeError
        For masked arrays.
    ValueError
        When the arrays do not fit together, or their numbers are out of range.
    """
    xarray = import_extra("xarray", "lifetime", "gate stacks as data sets")
    ones = _plain_counts(counts).copy()
    if ones.ndim != 3:
        raise ValueError(f"counts: expected shape (G, H, W), got {ones.shape}")
    times = _rising_times(gate_times, ones.shape)
    options: dict[str, Any] = {"first_photon": first_photon, "dark_counts": dark_counts}
    detections, error = gate_detections(ones, trials, **options)
    lifetime = decay_lifetime(ones, times, trials=trials, **options)
    dimensions = ("H", "Y", "X")
    attributes = {} if frequency is None else {"frequency": positive_number("frequency", frequency)}
    unit = {"units": "per gate and reading"}
    return xarray.Dataset(
        {
            # Programs for phasors take one array, and read the attributes of that.
            "detections": (dimensions, detections, unit | attributes),
            "standard_error": (dimensions, error, unit),
            "counts": (dimensions, ones, {"units": "1"}),
            "lifetime": (dimensions[1:], lifetime, {"units": "ns"}),
        },
        coords={"H": ("H", times, {"units": "ns", "long_name": "beginning of the gate"})},
        attrs=attributes,
    )
