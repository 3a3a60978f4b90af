"""Linear operators without a matrix, such as the spread of light from pixels to jots.

An operator is a pair of functions, forward and adjoint. :func:`spread` returns that of a sensor,
:func:`differences` that of total variation, and :func:`scaling` a multiple of the image.
:func:`check_adjoint` checks that the two functions of your own :class:`Operator` fit together.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar, Self, SupportsIndex

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.checks import check_threads, positive_number, whole_number_in_range
from jotlight.parameter_names import check_choice, takes_rng
from jotlight.seeds import SeedLike, random_generator
from jotlight.sensing.likelihood.checked_maps import (
    CheckedMap,
    LinearMap,
    array_of_shape,
    checked_shape,
)
from jotlight.sensing.sensor import KERNELS

__all__ = ["Operator", "Scaling", "Spread", "check_adjoint", "differences", "scaling", "spread"]


def __dir__() -> list[str]:
    return __all__


@dataclasses.dataclass(frozen=True)
class Operator:
    """A linear operator G and its adjoint Gᵀ.

    Parameters
    ----------
    forward : callable
        A function that maps x of `input_shape` to G x of `output_shape`, both in float64.
    adjoint : callable
        A function that maps y of `output_shape` to Gᵀ y of `input_shape`, both in float64.
    input_shape, output_shape : tuple of int
        The shapes of x and y.
    takes_stacks : bool
        Whether the functions also accept stacks, with one more axis before the others. Where they
        do not, the operator calls them for each array of a stack.

    Raises
    ------
    ValueError
        When a function returns an array of another shape.

    Examples
    --------
    >>> matrix = np.array([[1.0, 2.0], [0.0, 1.0], [3.0, 0.0]])
    >>> own = Operator(lambda x: matrix @ x, lambda y: matrix.T @ y, (2,), (3,))
    >>> check_adjoint(own) < 1e-12
    True
    """

    forward: LinearMap = dataclasses.field(repr=False)
    adjoint: LinearMap = dataclasses.field(repr=False)
    input_shape: tuple[int, ...]
    output_shape: tuple[int, ...]
    takes_stacks: bool = dataclasses.field(default=False, kw_only=True)
    _make: ClassVar[Any] = None

    def __post_init__(self) -> None:
        shapes = self.input_shape, self.output_shape
        for name, (before, after) in (("forward", shapes), ("adjoint", shapes[::-1])):
            dimensions = None if self.takes_stacks else len(before)
            checked = CheckedMap(name, getattr(self, name), dimensions, tuple(after))
            object.__setattr__(self, name, checked)

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        return super().__reduce_ex__(protocol) if self._make is None else (self._make, ())

    def _made_by(self, make: Callable[[], Operator]) -> Self:
        """Return the operator itself, which `pickle` makes again with a function."""
        object.__setattr__(self, "_make", make)
        return self

    def normal(self, weights: Array, image: Array) -> Array:
        """Return Gᵀ diag(`weights`) G `image`."""
        return self.adjoint(weights * self.forward(image))


@dataclasses.dataclass(frozen=True)
class Scaling(Operator):
    """Multiplication by `factor`: the operator of the box kernel for counts of pixels."""

    factor: float


@dataclasses.dataclass(frozen=True)
class Spread(Operator):
    """The spread of light over jots, with the arguments of :func:`spread`, which returns it."""

    oversampling: int
    kernel: str
    gain: float
    weighted_normal: Callable[[Array, Array], Array] = dataclasses.field(repr=False)

    @property
    def symmetric(self) -> bool:
        """Whether the kernel is symmetric about its pixel. Otherwise it is off by half a jot."""
        return KERNELS.index(self.kernel) * self.oversampling % 2 == 0

    def normal(self, weights: Array, image: Array) -> Array:
        """Return Gᵀ diag(`weights`) G `image`, without an intermediate map over the jots."""
        return self.weighted_normal(weights, image)


def scaling(shape: Sequence[int], factor: float) -> Scaling:
    """Return the operator that multiplies every pixel by `factor`.

    Examples
    --------
    >>> scaling((3,), 2.0).forward(np.ones(3)).tolist()
    [2.0, 2.0, 2.0]
    """
    shape = tuple(shape)

    def multiply(array: Array) -> Array:
        return factor * array_of_shape("array", array, shape)

    operator = Scaling(multiply, multiply, shape, shape, factor, takes_stacks=True)
    return operator._made_by(partial(scaling, shape, factor))


def spread(
    shape: Sequence[int],
    oversampling: int = 1,
    kernel: str = "box",
    *,
    gain: float = 1.0,
    threads: int | None = None,
) -> Spread:
    """Return the operator s = gain · G c, which spreads each pixel's light over the jots.

    Parameters
    ----------
    shape : (H, W) or (N,)
        The shape of an image, or of a signal. A signal is a line of pixels with K̂ jots each.
    oversampling : int
        K̂: the number of jots per pixel and dimension.
    kernel : {"box", "linear", "quadratic", "cubic"}
        The B-spline of :class:`jotlight.Sensor`.
    gain : float
        α/T for the light s, or η α/T for the detected light.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    Spread
        An operator from `shape` to (H * K̂, W * K̂) or (N * K̂,), in float64.

    Raises
    ------
    ValueError
        When an argument is out of range.

    Notes
    -----
    Paper, section 2.1, equation (2), for the box. In two dimensions the kernel is separable. The
    adjoint is exact, also at the mirrored border.

    Examples
    --------
    >>> line = spread((4,), oversampling=8, kernel="cubic", gain=8.0)
    >>> line.output_shape, line.forward(np.ones(4)).round(12).max()
    ((32,), np.float64(1.0))
    >>> check_adjoint(line) < 1e-12
    True
    """
    shape = checked_shape(shape)
    oversampling = whole_number_in_range("oversampling", oversampling, 1, 4096)
    check_choice("kernel", kernel, KERNELS)
    gain = positive_number("gain", gain)
    check_threads(threads)
    horizontal = (KERNELS.index(kernel), oversampling)
    # A signal is an image of one row, which is one jot high.
    vertical = horizontal if len(shape) == 2 else (0, 1)
    pixels = shape if len(shape) == 2 else (1, *shape)
    jots = (pixels[0] * vertical[1], pixels[1] * horizontal[1])
    output_shape = jots if len(shape) == 2 else jots[1:]
    description = (vertical, horizontal, gain)

    def forward(image: Array) -> Array:
        image = array_of_shape("image", image, shape)
        stack = image.reshape(-1, *pixels)
        out = np.empty((len(stack), *jots))
        engine.spread_forward(description, stack, out, threads)
        return out.reshape(*image.shape[: -len(shape)], *output_shape)

    def adjoint(light: Array) -> Array:
        light = array_of_shape("jots", light, output_shape)
        stack = light.reshape(-1, *jots)
        out = np.empty((len(stack), *pixels))
        engine.spread_adjoint(description, stack, out, threads)
        return out.reshape(*light.shape[: -len(shape)], *shape)

    def normal(weights: Array, image: Array) -> Array:
        image = array_of_shape("image", image, shape)
        weights = array_of_shape("weights", weights, output_shape).reshape(-1, *jots)
        stack = image.reshape(-1, *pixels)
        out = np.empty(stack.shape)
        weights = np.broadcast_to(weights, (len(stack), *jots))
        engine.spread_normal(description, weights, stack, out, threads)
        return out.reshape(image.shape)

    operator = Spread(
        forward, adjoint, shape, output_shape, oversampling, kernel, gain, normal, takes_stacks=True
    )
    make = partial(spread, shape, oversampling, kernel, gain=gain, threads=threads)
    return operator._made_by(make)


def differences(shape: Sequence[int], *, threads: int | None = None) -> Operator:
    """Return D, the differences of neighboring pixels. The sum of their lengths is TV.

    Parameters
    ----------
    shape : (H, W) or (N,)
        The shape of the image or signal.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    Operator
        An operator from `shape` to (2, H, W), downward and to the right, or to (1, N). The
        differences past the border are 0.

    Examples
    --------
    >>> differences((3,)).forward(np.array([1.0, 4.0, 2.0])).tolist()
    [[3.0, -2.0, 0.0]]
    """
    shape = checked_shape(shape)
    check_threads(threads)
    pixels = shape if len(shape) == 2 else (1, *shape)
    output_shape = (len(shape), *shape)

    def forward(image: Array) -> Array:
        image = array_of_shape("image", image, shape)
        stack = image.reshape(-1, *pixels)
        out = np.empty((len(stack), 2, *pixels))
        engine.differences(stack, out, threads)
        directions = out if len(shape) == 2 else out[:, 1:]
        return directions.reshape(*image.shape[: -len(shape)], *output_shape)

    def adjoint(planes: Array) -> Array:
        planes = array_of_shape("differences", planes, output_shape)
        stack = planes.reshape(-1, len(shape), *pixels)
        if len(shape) == 1:
            stack = np.concatenate([np.zeros_like(stack), stack], axis=1)
        out = np.empty((len(stack), *pixels))
        engine.differences_adjoint(stack, out, threads)
        return out.reshape(*planes.shape[: -len(output_shape)], *shape)

    operator = Operator(forward, adjoint, shape, output_shape, takes_stacks=True)
    return operator._made_by(partial(differences, shape, threads=threads))


@takes_rng
def check_adjoint(
    operator: Operator, *, rng: SeedLike = 0, draws: int = 3, tol: float = 1e-10
) -> float:
    """Return the largest error of ⟨G x, y⟩ = ⟨x, Gᵀ y⟩ for random x and y.

    Parameters
    ----------
    operator : Operator
        The operator, or any object with its four attributes.
    rng : int, numpy.random.Generator, numpy.random.SeedSequence or None
        The seed of x and y, which are normally distributed.
    draws : int
        The number of pairs of x and y.
    tol : float
        The largest error that counts as rounding.

    Returns
    -------
    float
        The largest ``|⟨G x, y⟩ - ⟨x, Gᵀ y⟩| / (‖G x‖ ‖y‖ + ‖x‖ ‖Gᵀ y‖)``.

    Raises
    ------
    ValueError
        When the error is above `tol`, or a function returns another shape, NaN or infinity.

    Examples
    --------
    >>> check_adjoint(spread((5, 7), oversampling=3, kernel="quadratic")) < 1e-12
    True
    """
    if draws < 1:
        raise ValueError(f"draws: expected 1 or more, got {draws}")
    random = random_generator(rng)
    worst = 0.0
    for _ in range(draws):
        x = random.standard_normal(operator.input_shape)
        y = random.standard_normal(operator.output_shape)
        image = np.asarray(operator.forward(x.copy()), np.float64)
        preimage = np.asarray(operator.adjoint(y.copy()), np.float64)
        for name, array, shape in (("forward", image, y.shape), ("adjoint", preimage, x.shape)):
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(
                    f"{name}: expected a finite array of shape {shape}, got shape {array.shape}"
                    + (" with NaN or infinity" if array.shape == shape else "")
                )
        size = _norm(image) * _norm(y) + _norm(x) * _norm(preimage)
        difference = abs(float(np.vdot(image, y)) - float(np.vdot(x, preimage)))
        worst = max(worst, float(difference / size) if size else 0.0)
    if worst > tol:
        raise ValueError(
            f"adjoint: expected ⟨G x, y⟩ = ⟨x, Gᵀ y⟩, got a relative difference of {worst:.2g}, "
            f"which is above tol = {tol:g}"
        )
    return worst


def _norm(array: Array) -> float:
    return float(np.linalg.norm(array.ravel()))
