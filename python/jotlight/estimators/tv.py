"""Total variation: its value, its proximal map, and the automatic choice of its weight.

:func:`total_variation` returns the value of an image, :func:`shrink` the proximal map, and
:func:`automatic_weight` the weight that :func:`jotlight.admm_tv` uses by default.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.checks import to_array
from jotlight.estimators.iterative.local_information import local_information
from jotlight.parameter_names import check_choice
from jotlight.sensing.bits.values import flatten
from jotlight.sensing.data.stacks import each_image, image_means, image_sums
from jotlight.sensing.likelihood.operators import differences
from jotlight.sensing.likelihood.problem import Problem
from jotlight.underflow import underflows_to_0

__all__ = ["NORMS", "automatic_weight", "shrink", "total_variation"]


def __dir__() -> list[str]:
    return __all__


NORMS = ("isotropic", "anisotropic")
"""The names of the norms of a pixel's two differences."""

WEIGHT_STRENGTH, WEIGHT_POWER = 0.62, 0.4
"""The constants of the automatic weight. ``benchmarks/studies/tv_weights.py`` fitted them to
BSDS training images at six exposures."""

TAIL = 0.05
"""The constant of the skewness in the automatic weight."""

_BLOCK = 4
"""The side, in pixels, of the blocks between which the roughness is measured."""


def total_variation(
    image: npt.ArrayLike, norm: str = "isotropic", *, weight: float | npt.ArrayLike = 1.0
) -> float:
    """Return the sum over the pixels of the weighted norm of the differences D c.

    Parameters
    ----------
    image : array_like of float, shape (H, W) or (N,)
        An image or a signal.
    norm : {"isotropic", "anisotropic"}
        √(down² + right²), or abs(down) + abs(right).
    weight : float or array_like of float
        A number, or a map of the image's shape, finite and at least 0.

    Raises
    ------
    ValueError
        For another shape, norm, or weight.

    Examples
    --------
    >>> corner = np.array([[0.0, 0.0], [0.0, 1.0]])
    >>> total_variation(corner), total_variation(1 - corner[::-1, ::-1], "anisotropic")
    (2.0, 2.0)
    """
    values = np.asarray(to_array("image", image), np.float64)
    if values.ndim not in (1, 2) or values.size == 0:
        raise ValueError(
            f"image: expected shape (H, W) or (N,) with at least one pixel, got {values.shape}"
        )
    weights = check_map("weight", weight, values.shape)
    return float(total_variations(values[None], check_norm(norm), weights)[0])


def total_variations(
    images: Array, norm: str, weight: float | Array, threads: int | None = None
) -> Array:
    """Return the weighted total variation of each image of a stack, (N,).

    Parameters
    ----------
    images : ndarray of float64, shape (N, H, W) or (N, length)
        Images or signals.
    norm : {"isotropic", "anisotropic"}
        As for :func:`total_variation`.
    weight : float or ndarray of float64
        A number, or one for each pixel of each image.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> total_variations(np.array([[1.0, 3.0, 3.0], [0.0, 0.0, 0.0]]), "isotropic", 0.5).tolist()
    [1.0, 0.0]
    """
    rows = images.shape[1:] if images.ndim == 3 else (1, *images.shape[1:])
    planes = differences(rows, threads=threads).forward(images.reshape(-1, *rows))
    return np.array(engine.total_variation(planes, flatten(weight), norm == "isotropic", threads))


def shrink(
    planes: npt.ArrayLike, threshold: float | npt.ArrayLike, norm: str = "isotropic"
) -> Array:
    """Return the differences with the norm of each pixel shrunk: the proximal map of the norm.

    The result v minimizes ``sum(threshold * norm(v)) + ½ ‖v - planes‖²``.

    Parameters
    ----------
    planes : array_like of float, shape (2, H, W) or (1, N)
        The differences of an image, downward and to the right, or of a signal.
    threshold : float or array_like of float
        A number, or a map (H, W) or (N,), finite and at least 0.
    norm : {"isotropic", "anisotropic"}
        As for :func:`total_variation`.

    Returns
    -------
    ndarray of float64
        An array of the same shape.

    Raises
    ------
    ValueError
        For another shape, norm, or threshold, and for NaN.

    Examples
    --------
    >>> shrink([[[3.0]], [[4.0]]], 1.0).ravel().round(6).tolist()
    [2.4, 3.2]
    >>> shrink([[[3.0]], [[4.0]]], 1.0, "anisotropic").ravel().tolist()
    [2.0, 3.0]
    """
    values = np.array(to_array("planes", planes), np.float64, order="C")
    if values.ndim not in (2, 3) or values.shape[0] != values.ndim - 1 or values.size == 0:
        raise ValueError(f"planes: expected shape (2, H, W) or (1, N), got {values.shape}")
    if np.isnan(values).any():
        raise ValueError("planes: expected numbers, got NaN")
    pairs = values if values.ndim == 3 else np.stack([np.zeros_like(values), values])
    thresholds = check_map("threshold", threshold, values.shape[1:])
    stack = pairs.reshape(1, 2, -1, values.shape[-1])
    engine.shrink(stack, thresholds, check_norm(norm) == "isotropic", None)
    return pairs if values.ndim == 3 else pairs[1]


def automatic_weight(problem: Problem, *, norm: str = "isotropic") -> Array:
    """Return a weight of total variation for each pixel, chosen from the data alone.

    ``λ = 0.62 √(I (1 + 0.05 b²)) (√Ī γ)^-0.4``. I is the Fisher information of the pixel's bits
    about its intensity, Ī that of a pixel of the mean intensity, and b the skewness of the pixel's
    number of ones. γ is the roughness of the scene: the root mean square difference between
    neighboring blocks of 4 x 4 pixels, minus the part that the noise explains.

    Parameters
    ----------
    problem : Problem
        The data and their operator, for one image or a stack.
    norm : {"isotropic", "anisotropic"}
        Averaged over the directions of an edge, anisotropic variation is 4/π times as large as
        isotropic variation. Its weight is smaller by this factor.

    Returns
    -------
    ndarray of float64
        λ in nats per unit of intensity, of the shape of the image or of the stack.

    Raises
    ------
    ValueError
        For another norm.

    Notes
    -----
    1/√I is the noise of a pixel. With λ ∝ √I, total variation acts as if the noise were the same
    everywhere, as it is for stabilized counts. √Ī γ is the roughness in units of the noise: the
    less structure is visible, the more smoothing is needed. The dimensionless constants were
    fitted once, over a range of exposures.

    In a dim scene of n ones per pixel, the rare ones are outliers of the noise: their scores are
    1/√n times its standard deviation. Since b² = 1/n, λ then exceeds what a lone one gains by a
    peak of its own.

    I and b are evaluated at the local fraction of ones: the fraction is smoothed by a Gaussian of
    standard deviation 2 pixels, or more if the window would contain fewer than 20 ones or 20 zeros
    on average, and kept away from 0 and 1 as in equation (6). The difference of a block from the
    mean is its score divided by its information, which is one step of Fisher scoring from a
    constant image.

    Examples
    --------
    >>> from jotlight.sensing.likelihood.operators import scaling
    >>> ones = np.random.default_rng(0).binomial(16, 0.3, (64, 64))
    >>> likelihood = jl.Likelihood(ones, trials=16)
    >>> weight = automatic_weight(jl.Problem(scaling((64, 64), 1.0), likelihood))
    >>> weight.shape, bool(weight.mean() > 5)  # The image is nothing but noise: smooth it all.
    ((64, 64), True)
    """
    stack = problem.stacked()
    operator, likelihood = stack.operator, stack.likelihood
    light_of_ones = operator.forward(np.ones(operator.input_shape))
    constant = each_image(stack.constant_estimates(), likelihood.ones) * light_of_ones
    score = operator.adjoint(likelihood.gradient_and_curvature(constant)[0])
    information = operator.adjoint(likelihood.information(constant) * light_of_ones)
    local = np.sqrt(tailed_information(*local_information(stack, light_of_ones, constant)))
    mean = image_means(information)
    # If nearly all bits are saturated, the roughness is unknown, and 1 stands in for it.
    known = mean > 1e-6 * image_means(np.square(local))
    with np.errstate(over="ignore", invalid="ignore"):
        roughness = _roughness(score, information, stack.intensity_scales()) * np.sqrt(mean)
    roughness = np.where(known, roughness, 1.0)
    norm_factor = math.pi / 4 if check_norm(norm) == "anisotropic" and local.ndim == 3 else 1.0
    weight = norm_factor * WEIGHT_STRENGTH * each_image(roughness**-WEIGHT_POWER, local) * local
    return weight if problem.is_stack else weight[0]


def tailed_information(information: Array, skewness: Array) -> Array:
    """Return I (1 + 0.05 b²), from the results of `local_information`.

    Examples
    --------
    >>> tailed_information(np.array([1.0, 2.0]), np.array([0.0, 20.0])).tolist()
    [1.0, 4.0]
    """
    return np.asarray(information * (1 + TAIL * skewness))


@underflows_to_0
def _roughness(score: Array, information: Array, scale: Array) -> Array:
    """Return γ of each image, at least its uncertainty due to noise.

    For a single block, it is the scale of the image.
    """
    sides = [min(_BLOCK, max(1, size // 2)) for size in score.shape[1:]]
    score, information = _block_sums(score, sides), _block_sums(information, sides)
    known = information > 0
    variance = 1 / np.where(known, information, 1)
    deviation = score * variance
    square, expected, number = (np.zeros(len(score)) for _ in range(3))
    for axis in range(1, score.ndim):
        lines, variances = np.moveaxis(deviation, axis, 1), np.moveaxis(variance, axis, 1)
        valid = np.moveaxis(known, axis, 1)
        both = valid[:, 1:] & valid[:, :-1]
        square += image_sums(np.where(both, np.square(np.diff(lines, axis=1)), 0.0))
        expected += image_sums(np.where(both, variances[:, 1:] + variances[:, :-1], 0.0))
        number += image_sums(both)
    several = number > 0
    number = np.maximum(number, 1)
    square, expected = square / number, expected / number
    uncertainty = expected * np.sqrt(2 / number)
    return np.where(several, np.sqrt(np.maximum(square - expected, uncertainty)), scale)


def _block_sums(images: Array, sides: list[int]) -> Array:
    for axis, side in enumerate(sides, start=1):
        size = images.shape[axis] // side * side
        cropped = np.moveaxis(images, axis, 1)[:, :size]
        blocks = cropped.reshape(len(images), -1, side, *cropped.shape[2:])
        images = np.moveaxis(blocks.sum(axis=2), 1, axis)
    return images


def check_map(name: str, value: float | npt.ArrayLike, shape: tuple[int, ...]) -> float | Array:
    """Return a finite number of 0 or more, or a map of such numbers, flattened for the engine.

    Raises
    ------
    ValueError
        For an array of another shape, and for negative or infinite numbers and NaN.

    Examples
    --------
    >>> check_map("weight", 2, (4, 4)), check_map("weight", [[1.0, 3.0]], (1, 2)).tolist()
    (2.0, [1.0, 3.0])
    """
    array = to_array(name, value)
    if array.dtype.kind not in "iuf" or array.shape not in ((), shape) or array.size == 0:
        expected = f"a number, or an array of shape {shape}" if shape else "a number"
        received = repr(value) if array.ndim == 0 else f"{array.dtype} of shape {array.shape}"
        raise ValueError(f"{name}: expected {expected}, got {received}")
    if not (np.isfinite(array).all() and array.min() >= 0):
        raise ValueError(f"{name}: expected finite numbers, 0 or more, got {array.min()}")
    if array.ndim == 0:
        return float(array)
    return np.array(array, np.float64).reshape(-1)


def check_norm(norm: str) -> str:
    """Return `norm`, which must be the name of a norm.

    Raises
    ------
    ValueError
        For a name that is not in :data:`NORMS`.

    Examples
    --------
    >>> check_norm("isotropic")
    'isotropic'
    """
    check_choice("norm", norm, NORMS)
    return norm
