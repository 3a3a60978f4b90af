"""Total variation: its value, its proximal map, and how much of it to allow."""

import math

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.sensing.likelihood import Array, Likelihood, Problem
from jotlight.sensing.operators import differences

NORMS = ("isotropic", "anisotropic")
"""How the two differences of a pixel make its share of the total variation."""

_STRENGTH, _POWER = 0.62, 0.4
"""Chosen on BSDS training images over six exposures: ``benchmarks/studies/weights.py``."""

_BLOCK = 4
"""Pixels along the side of the blocks by which roughness is measured."""

_BLUR = 2.0
"""Standard deviation in pixels of the Gaussian that gives a first idea of the local light."""


_POINTS = 1025
"""Of the curve from the share of ones to the information of a bit."""


def total_variation(
    image: npt.ArrayLike, norm: str = "isotropic", *, weight: float | npt.ArrayLike = 1.0
) -> float:
    """Sum the lengths of the differences D c of an image (H, W) or a signal (N,).

    `weight` may be a number or a map of the image's shape, by which each pixel's length counts.

    Examples
    --------
    >>> corner = np.array([[0.0, 0.0], [0.0, 1.0]])
    >>> total_variation(corner), total_variation(1 - corner[::-1, ::-1], "anisotropic")
    (2.0, 2.0)
    """
    values = np.asarray(image, np.float64)
    if values.ndim not in (1, 2) or values.size == 0:
        raise ValueError(f"image: expected shape (H, W) or (N,), none of it 0, got {values.shape}")
    rows = values.reshape((1, -1) if values.ndim == 1 else values.shape)
    planes = differences(rows.shape).forward(rows)
    weights = check_map("weight", weight, values.shape)
    return engine.total_variation(planes, weights, check_norm(norm) == "isotropic", None)


def shrink(
    planes: npt.ArrayLike, threshold: float | npt.ArrayLike, norm: str = "isotropic"
) -> Array:
    """Give the proximal map of a sum of lengths, of differences (2, H, W) or (1, N).

    It is the v with the least ``sum(threshold * length(v)) + ½ ‖v - planes‖²``.

    Examples
    --------
    >>> shrink([[[3.0]], [[4.0]]], 1.0).ravel().round(6).tolist()
    [2.4, 3.2]
    >>> shrink([[[3.0]], [[4.0]]], 1.0, "anisotropic").ravel().tolist()
    [2.0, 3.0]
    """
    values = np.array(planes, np.float64, order="C")
    if values.ndim not in (2, 3) or values.shape[0] != values.ndim - 1 or values.size == 0:
        raise ValueError(f"planes: expected shape (2, H, W) or (1, N), got {values.shape}")
    if np.isnan(values).any():
        raise ValueError("planes: expected numbers, got NaN")
    whole = values if values.ndim == 3 else np.stack([np.zeros_like(values), values])
    thresholds = check_map("threshold", threshold, values.shape[1:])
    engine.shrink(whole, thresholds, check_norm(norm) == "isotropic", None)
    return whole if values.ndim == 3 else whole[1]


def automatic_weight(problem: Problem, *, norm: str = "isotropic") -> Array:
    """Choose the weight of total variation from the data alone, for each pixel.

    ``λ = 0.62 √I (√Ī γ)^-0.4`` with I the Fisher information that the pixel's bits have about its
    intensity, Ī that of a pixel as bright as the mean, and γ the roughness of the scene, the root
    mean square difference between neighbouring blocks of 4 x 4 pixels less what noise makes of it.

    Parameters
    ----------
    problem : Problem
        The data.
    norm : {"isotropic", "anisotropic"}
        Anisotropic variation is 4/π times as large for an edge in any direction, and its weight
        that much smaller.

    Returns
    -------
    ndarray of float64
        Of the picture's shape, in nats per unit of intensity.

    Notes
    -----
    1/√I is the noise of a pixel, and λ ∝ √I makes total variation what it would be on the scale on
    which the noise is the same everywhere, that of the stabilised counts. √Ī γ is the scene's
    roughness in units of the noise: the less of it shows, the more has to be smoothed. The two
    numbers were fitted once, over a range of exposures, and are in no unit.

    I is that at the local share of ones, seen through a Gaussian of standard deviation 2 pixels and
    kept from 0 and 1 as in equation (6). A block's intensity, less the mean, is its score over its
    information: one Fisher-scoring step from the even picture.

    Examples
    --------
    >>> from jotlight.sensing.operators import scaling
    >>> ones = np.random.default_rng(0).binomial(16, 0.3, (64, 64))
    >>> even = automatic_weight(Problem(scaling((64, 64), 1.0), Likelihood(ones, trials=16)))
    >>> even.shape, bool(even.mean() > 5)  # nothing but noise: smooth it all
    ((64, 64), True)
    """
    operator, likelihood = problem.operator, problem.likelihood
    mean = problem.constant_estimate()
    even = operator.forward(np.full(operator.input_shape, mean))
    of_ones = operator.forward(np.ones(operator.input_shape))
    score = operator.adjoint(likelihood.gradient_and_curvature(even)[0])
    information = operator.adjoint(likelihood.information(even) * of_ones)
    local = np.sqrt(_local_information(problem, of_ones))
    roughness = 1.0
    # So much light that an even picture would say nothing: nothing tells how rough it is.
    if information.mean() > 1e-6 * np.square(local).mean():
        noise = 1 / math.sqrt(information.mean())
        roughness = _roughness(score, information, problem.max_intensity) / noise
    per_direction = math.pi / 4 if check_norm(norm) == "anisotropic" and local.ndim == 2 else 1.0
    return np.asarray(per_direction * _STRENGTH * roughness**-_POWER * local)


def _roughness(score: Array, information: Array, most: float) -> float:
    """γ; at least what noise alone may look like, and `most` for a picture of one block."""
    sides = [min(_BLOCK, max(1, size // 2)) for size in score.shape]
    score, information = _block_sums(score, sides), _block_sums(information, sides)
    known = information > 0
    variance = 1 / np.where(known, information, 1)
    deviation = score * variance
    squares, noise = [], []
    for axis in range(score.ndim):
        lines, doubts = np.moveaxis(deviation, axis, 0), np.moveaxis(variance, axis, 0)
        seen = np.moveaxis(known, axis, 0)
        both = seen[1:] & seen[:-1]
        squares.append(np.square(np.diff(lines, axis=0))[both])
        noise.append((doubts[1:] + doubts[:-1])[both])
    square, expected = np.concatenate(squares), np.concatenate(noise)
    if square.size == 0:
        return most
    doubt = expected.mean() * math.sqrt(2 / square.size)
    return math.sqrt(max(square.mean() - expected.mean(), doubt))


def _block_sums(image: Array, sides: list[int]) -> Array:
    for axis, side in enumerate(sides):
        size = image.shape[axis] // side * side
        cut = np.moveaxis(image, axis, 0)[:size]
        image = np.moveaxis(cut.reshape(-1, side, *cut.shape[1:]).sum(axis=1), 0, axis)
    return image


def _local_information(problem: Problem, of_ones: Array) -> Array:
    """I of each pixel, as if all of them had as many valid bits."""
    from scipy.ndimage import gaussian_filter
    from scipy.special import gammaincinv

    operator, likelihood = problem.operator, problem.likelihood
    trials = np.broadcast_to(np.asarray(likelihood.trials, np.float64), likelihood.shape)
    ones, valid = (
        gaussian_filter(operator.adjoint(array), _BLUR, mode="reflect")
        for array in (likelihood.ones.astype(np.float64), trials)
    )
    overall = likelihood.ones.sum() / trials.sum()
    share = np.where(valid > 0, ones / np.where(valid > 0, valid, 1), overall)
    bits = trials.sum() / share.size
    # A smooth function of the share alone, as in equation (6) kept from both ends.
    shares = np.linspace(0, 1, _POINTS)
    rates = gammaincinv(likelihood.threshold, (bits * shares + 3 / 8) / (bits + 3 / 4))
    one_bit = Likelihood(np.zeros(_POINTS, np.int32), 1, threshold=likelihood.threshold)
    information = np.interp(share, shares, one_bit.information(rates))
    return np.asarray(bits * of_ones.mean() ** 2 * information)


def check_map(name: str, value: float | npt.ArrayLike, shape: tuple[int, ...]) -> float | Array:
    """Check a number or a map of numbers, 0 or more; the map comes back flat, for the engine.

    Raises
    ------
    ValueError
        For another shape, and for what is below 0, infinite or NaN.
    """
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.shape not in ((), shape) or array.size == 0:
        raise ValueError(
            f"{name}: expected a number, or an array of shape {shape}, got {array.dtype} of shape "
            f"{array.shape}"
        )
    if not (np.isfinite(array).all() and array.min() >= 0):
        raise ValueError(f"{name}: expected finite numbers, 0 or more, got {array.min()}")
    if array.ndim == 0:
        return float(array)
    return np.array(array, np.float64).reshape(-1)


def check_norm(norm: str) -> str:
    """Give the name of a norm back.

    Raises
    ------
    ValueError
        When there is none of that name.
    """
    if norm not in NORMS:
        raise ValueError(f"norm: expected one of {', '.join(NORMS)}, got {norm!r}")
    return norm
