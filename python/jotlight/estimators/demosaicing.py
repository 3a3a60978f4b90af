"""Demosaicing: red, green, and blue of all pixels, from one filter at each pixel."""

import threading
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Pattern
from jotlight.errors import import_extra
from jotlight.estimators.trial_levels import fill_from_nearest
from jotlight.parameter_names import check_choice
from jotlight.sensing.parameters.mosaic import Mosaic

TITLES = {"menon": "Menon 2007", "differences": "color differences"}
"""The methods of demosaicing, and their titles."""

BASE_SPREAD = 0.45
"""Standard deviation of the Gaussian that interpolates the densest filter, in mean distances of its
pixels."""

SPREAD = 1.0
"""The same for the differences of other filters from it. A wide Gaussian averages their noise, and
colors vary less than brightness. Decision 47 has the measurement behind this number."""

_PURPOSE = "the colors from the planes of a Bayer mosaic"
_INSTEAD = 'or pass demosaicing="differences" (--demosaicing differences)'

_IMPORT = threading.Lock()
"""It is held while Menon's method is imported."""

_MIN_WEIGHT = 1e-6
"""Weight below which a pixel has no neighbors within the Gaussian."""

MIN_RELATIVE_WEIGHT = 1e-6
"""Smallest weight of a filter, relative to the largest one, so that all colors are determined."""

COLORS = 3
"""Red, green, and blue."""


def choose_demosaicing(mosaic: Mosaic, method: str | None) -> str:
    """Return the method of demosaicing: the requested one, or the default of the mosaic.

    Raises
    ------
    ValueError
        When the method is unknown, or does not serve the mosaic.

    Examples
    --------
    >>> choose_demosaicing(Mosaic("RGGB"), None), choose_demosaicing(Mosaic("RGBW"), None)
    ('menon', 'differences')
    """
    if method is None:
        return "menon" if mosaic.bayer else "differences"
    check_choice("demosaicing", method, TITLES)
    if method == "menon" and mosaic.bayer is None:
        raise ValueError(
            f"demosaicing: menon is for RGGB, BGGR, GRBG, and GBRG, got {mosaic!r}; "
            'demosaicing="differences" (--demosaicing differences) takes every mosaic'
        )
    return method


def demosaic(
    values: npt.NDArray[np.floating],
    mosaic: Mosaic,
    method: str | None = None,
    weights: npt.NDArray[np.floating] | None = None,
) -> npt.NDArray[np.float64]:
    """Return red, green, and blue of all pixels.

    Parameters
    ----------
    values : ndarray of float, shape (H, W)
        The intensity behind the filter of each pixel, divided by the sensitivity of the filter, so
        that all pixels of a white image have the same value.
    mosaic : Mosaic
        The filters.
    method : {"menon", "differences"}, optional
        "menon" is directional filtering with a-posteriori decision, for Bayer mosaics, by the
        package colour-demosaicing (extra `color`). "differences" interpolates the values of the
        densest filter, and adds local means of the differences of the others from it. Default:
        "menon" for a Bayer mosaic, and "differences" for others.
    weights : ndarray of float, shape (H, W), optional
        How much each value counts where more than three filters overdetermine the colors. Default:
        as much as the filter of the pixel passes light.

    Returns
    -------
    ndarray of float64, shape (H, W, 3)
        Colors, with the inverse of the transmission and with the white balance. They are not
        clipped.

    Raises
    ------
    MissingExtraError
        When "menon" needs the extra `color`, which is not installed.
    ValueError
        When the mosaic does not fit the values, or the method does not fit the mosaic.

    Notes
    -----
    D. Menon, S. Andriani, G. Calvagno, "Demosaicing with directional filtering and a posteriori
    decision", IEEE Transactions on Image Processing 16 (2007). H. Knutsson, C.-F. Westin,
    "Normalized and differential convolution", CVPR 1993: the local mean at a pixel is that of the
    known values with Gaussian weights.

    Examples
    --------
    >>> gray = np.full((6, 6), 0.25)
    >>> demosaic(gray, Mosaic("RGBW"))[3, 3].round(6).tolist()
    [0.25, 0.25, 0.25]
    """
    method = choose_demosaicing(mosaic, method)
    image = np.asarray(values, np.float64)
    places = mosaic.full(*image.shape)
    share = np.bincount(places.ravel(), minlength=len(mosaic.filters)) / places.size
    usual = share * mosaic.sensitivity
    mosaic.inverse(usual)  # Menon's method fails without one of the filters
    if method == "menon":
        assert mosaic.bayer is not None, "choose_demosaicing checked it"
        planes = _menon(image, mosaic.bayer)
        planes = planes[..., ["RGB".index(letter) for letter in mosaic.filters]]
    else:
        planes = _differences(image, places, share)
    if weights is None or np.count_nonzero(share) <= COLORS:
        return mosaic.colors(planes, usual)
    return mosaic.colors(planes, _near_weights(weights, places, usual))


def _near_weights(weights: npt.NDArray[np.floating], places: Pattern, usual: Array) -> Array:
    """Return the mean weight of the pixels of each filter around each pixel, (H, W, N).

    The largest one is 1. Where all are 0, they are the usual ones.
    """
    found = np.zeros((*places.shape, len(usual)))
    for index in np.flatnonzero(usual):
        own = places == index
        found[..., index] = own.mean() * local_mean(np.asarray(weights, float), own, SPREAD)
    largest = found.max(axis=-1, keepdims=True)
    found = np.where(largest > 0, found / np.where(largest > 0, largest, 1.0), usual)
    return np.asarray(np.maximum(found, MIN_RELATIVE_WEIGHT * (usual > 0)))


def check_installed(method: str) -> None:
    """Raise MissingExtraError if a method of demosaicing needs an extra that is not installed.

    Callers check before they estimate planes, which may take minutes.

    Examples
    --------
    >>> check_installed("differences")
    """
    if method == "menon":
        _menon_package()


def _menon_package() -> Any:
    # The package imports an old name of SciPy, warns of packages that it does without, and changes
    # how NumPy prints arrays. Several threads must not change the filters of warnings at the same
    # time.
    with _IMPORT, warnings.catch_warnings(), np.printoptions():
        warnings.simplefilter("ignore")
        return import_extra("colour_demosaicing", "color", _PURPOSE, _INSTEAD)


def _menon(values: Array, order: str) -> Array:
    """Return the values of a Bayer mosaic behind each of the filters R, G, and B."""
    package = _menon_package()
    return np.asarray(package.demosaicing_CFA_Bayer_Menon2007(values, order), np.float64)


def _differences(values: Array, places: Pattern, share: Array) -> Array:
    """Return the values behind each filter, (H, W, N), from differences to the densest one."""
    densest = int(np.argmax(share))
    known = places == densest
    base = np.where(known, values, local_mean(values, known, BASE_SPREAD))
    planes = np.repeat(base[..., None], len(share), axis=2)
    for index in np.flatnonzero(share):
        if index != densest:
            planes[..., index] += local_mean(values - base, places == index, SPREAD)
    return planes


def brightest_mean(values: npt.NDArray[np.floating], places: Pattern) -> Array:
    """Return the largest of the local means of the values behind each filter, (H, W).

    Where pixels of some filters are saturated, the others show how bright the scene is.

    Examples
    --------
    >>> brightest_mean(np.array([[0.5, 0.2, 0.5]]), np.array([[0, 1, 0]])).round(6).tolist()
    [[0.5, 0.5, 0.5]]
    """
    each = np.asarray(values, np.float64)
    means = [local_mean(each, places == index, SPREAD) for index in np.unique(places)]
    return np.asarray(np.max(means, axis=0))


def local_mean(values: Array, known: npt.NDArray[np.bool_], spread: float) -> Array:
    """Return the mean of the known values around each pixel, with Gaussian weights.

    Where no known pixel is near, the Gaussian is wider, up to the size of the image. Pixels that
    are still too far away have the value of the nearest pixel with a mean.

    Parameters
    ----------
    values : ndarray of float64, shape (H, W)
        The values.
    known : ndarray of bool, shape (H, W)
        The pixels with a known value, at least one.
    spread : float
        The standard deviation of the Gaussian, in mean distances of the known pixels.

    Examples
    --------
    >>> known = np.array([[True, False, True]])
    >>> local_mean(np.array([[1.0, 9.0, 3.0]]), known, 0.45).round(2).tolist()
    [[1.0, 2.0, 3.0]]
    """
    from scipy.ndimage import gaussian_filter

    weights, weighted = known.astype(np.float64), np.where(known, values, 0.0)
    result = np.zeros(values.shape)
    missing, sigma = np.ones(values.shape, bool), spread / np.sqrt(known.mean())
    widest = max(sigma, *values.shape)
    while missing.any() and sigma <= widest:
        weight = gaussian_filter(weights, sigma, mode="constant")
        near = missing & (weight > _MIN_WEIGHT)
        result[near] = gaussian_filter(weighted, sigma, mode="constant")[near] / weight[near]
        missing &= ~near
        sigma *= 2
    return fill_from_nearest(result, ~missing).astype(np.float64) if missing.any() else result
