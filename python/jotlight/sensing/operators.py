"""Linear operators without a matrix: from the intensities c to the light on the jots, and back.

An operator is a pair of functions. :func:`check_adjoint` tells whether they belong together, for
operators of your own too.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from operator import index

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.seeds import SeedLike
from jotlight.sensing.sensor import KERNELS

Array = npt.NDArray[np.float64]
Function = Callable[[Array], Array]


@dataclasses.dataclass(frozen=True)
class Operator:
    """A linear operator G and its adjoint Gᵀ.

    Parameters
    ----------
    forward : callable
        x to G x: an array of float64 of `input_shape` to one of `output_shape`.
    adjoint : callable
        y to Gᵀ y: an array of float64 of `output_shape` to one of `input_shape`.
    input_shape, output_shape : tuple of int
        Shapes of x and y.

    Raises
    ------
    ValueError
        When a function gives an array of another shape.

    Examples
    --------
    >>> matrix = np.array([[1.0, 2.0], [0.0, 1.0], [3.0, 0.0]])
    >>> own = Operator(lambda x: matrix @ x, lambda y: matrix.T @ y, (2,), (3,))
    >>> check_adjoint(own) < 1e-12
    True
    """

    forward: Function
    adjoint: Function
    input_shape: tuple[int, ...]
    output_shape: tuple[int, ...]

    def __post_init__(self) -> None:
        for name, shape in (("forward", self.output_shape), ("adjoint", self.input_shape)):
            object.__setattr__(self, name, _giving(shape, name, getattr(self, name)))

    def normal(self, weights: Array, image: Array) -> Array:
        """Give Gᵀ diag(`weights`) G `image`."""
        return self.adjoint(weights * self.forward(image))


@dataclasses.dataclass(frozen=True)
class Scaling(Operator):
    """Multiplication by a number: the box kernel, once each pixel's bits are counted."""

    factor: float


@dataclasses.dataclass(frozen=True)
class Spread(Operator):
    """What :func:`spread` gives."""

    oversampling: int
    kernel: str
    gain: float
    weighted: Callable[[Array, Array], Array]

    @property
    def symmetric(self) -> bool:
        """Whether the kernel is symmetric about its pixel, and not shifted by half a jot."""
        return KERNELS.index(self.kernel) * self.oversampling % 2 == 0

    def normal(self, weights: Array, image: Array) -> Array:
        """Give Gᵀ diag(`weights`) G `image`, without a map over the jots on the way."""
        return self.weighted(weights, image)


def scaling(shape: Sequence[int], factor: float) -> Scaling:
    """Give the operator that multiplies every pixel by `factor`.

    Examples
    --------
    >>> scaling((3,), 2.0).forward(np.ones(3)).tolist()
    [2.0, 2.0, 2.0]
    """
    shape = tuple(shape)

    def multiply(array: Array) -> Array:
        return factor * _fitting("array", array, shape)

    return Scaling(multiply, multiply, shape, shape, factor)


def spread(
    shape: Sequence[int],
    oversampling: int = 1,
    kernel: str = "box",
    *,
    gain: float = 1.0,
    threads: int | None = None,
) -> Spread:
    """Give the operator s = gain · G c, which spreads each pixel's light over the jots.

    Parameters
    ----------
    shape : (H, W) or (N,)
        Of the image, or of a signal: a line of pixels, each with K̂ jots in a row.
    oversampling : int
        K̂: jots per pixel and dimension.
    kernel : {"box", "linear", "quadratic", "cubic"}
        As in :class:`jotlight.Sensor`.
    gain : float
        α/T for s, or η α/T for what is detected of it.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    Spread
        From `shape` to (H * K̂, W * K̂) or (N * K̂,), in float64.

    Raises
    ------
    ValueError
        For a shape, oversampling or kernel that is none.

    Notes
    -----
    Paper, section 2.1, equation (2) for the box. In two dimensions the kernel is separable. The
    adjoint is exact, the mirrored rim included.

    Examples
    --------
    >>> line = spread((4,), oversampling=8, kernel="cubic", gain=8.0)
    >>> line.output_shape, line.forward(np.ones(4)).round(12).max()
    ((32,), np.float64(1.0))
    >>> check_adjoint(line) < 1e-12
    True
    """
    shape = _pixels(shape)
    if not 1 <= oversampling <= 4096 or oversampling != int(oversampling):
        raise ValueError(
            f"oversampling: expected a whole number from 1 to 4096, got {oversampling!r}"
        )
    if kernel not in KERNELS:
        raise ValueError(f"kernel: expected one of {', '.join(KERNELS)}, got {kernel!r}")
    if not (math.isfinite(gain) and gain > 0):
        raise ValueError(f"gain: expected a finite number above 0, got {gain!r}")
    along = (KERNELS.index(kernel), int(oversampling))
    # A signal is an image of one row, which is one jot high.
    down = along if len(shape) == 2 else (0, 1)
    pixels = shape if len(shape) == 2 else (1, *shape)
    jots = (pixels[0] * down[1], pixels[1] * along[1])
    output_shape = jots if len(shape) == 2 else jots[1:]
    description = (down, along, float(gain))

    def forward(image: Array) -> Array:
        out = np.empty(jots)
        plane = _fitting("image", image, shape).reshape(pixels)
        engine.spread_forward(description, plane, out, threads)
        return out.reshape(output_shape)

    def adjoint(light: Array) -> Array:
        out = np.empty(pixels)
        plane = _fitting("jots", light, output_shape).reshape(jots)
        engine.spread_adjoint(description, plane, out, threads)
        return out.reshape(shape)

    def normal(weights: Array, image: Array) -> Array:
        out = np.empty(pixels)
        plane = _fitting("image", image, shape).reshape(pixels)
        weights = _fitting("weights", weights, output_shape).reshape(jots)
        engine.spread_normal(description, weights, plane, out, threads)
        return out.reshape(shape)

    return Spread(
        forward, adjoint, shape, output_shape, int(oversampling), kernel, float(gain), normal
    )


def differences(shape: Sequence[int], *, threads: int | None = None) -> Operator:
    """Give D, the differences to the next pixels, whose lengths sum to the total variation.

    Parameters
    ----------
    shape : (H, W) or (N,)
        Of the image or signal.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    Operator
        From `shape` to (2, H, W), downwards and to the right, or (1, N); 0 past the rim.

    Examples
    --------
    >>> differences((3,)).forward(np.array([1.0, 4.0, 2.0])).tolist()
    [[3.0, -2.0, 0.0]]
    """
    shape = _pixels(shape)
    pixels = shape if len(shape) == 2 else (1, *shape)
    output_shape = (len(shape), *shape)

    def forward(image: Array) -> Array:
        out = np.empty((2, *pixels))
        engine.differences(_fitting("image", image, shape).reshape(pixels), out, threads)
        return out if len(shape) == 2 else out[1]

    def adjoint(planes: Array) -> Array:
        planes = _fitting("differences", planes, output_shape)
        if len(shape) == 1:
            planes = np.stack([np.zeros_like(planes), planes])
        out = np.empty(pixels)
        engine.differences_adjoint(planes, out, threads)
        return out.reshape(shape)

    return Operator(forward, adjoint, shape, output_shape)


def check_adjoint(
    operator: Operator, *, rng: SeedLike = 0, draws: int = 3, tol: float = 1e-10
) -> float:
    """Check that ⟨G x, y⟩ = ⟨x, Gᵀ y⟩ for random x and y.

    Parameters
    ----------
    operator : Operator
        Or any object with its four attributes.
    rng : int, numpy.random.Generator, numpy.random.SeedSequence or None
        Of x and y, which are normally distributed.
    draws : int
        Pairs to try.
    tol : float
        The largest difference that counts as rounding.

    Returns
    -------
    float
        The largest |⟨G x, y⟩ - ⟨x, Gᵀ y⟩| / (‖G x‖ ‖y‖ + ‖x‖ ‖Gᵀ y‖).

    Raises
    ------
    ValueError
        When that is above `tol`, or a function gives another shape, NaN or infinity.

    Examples
    --------
    >>> check_adjoint(spread((5, 7), oversampling=3, kernel="quadratic")) < 1e-12
    True
    """
    if draws < 1:
        raise ValueError(f"draws: expected 1 or more, got {draws}")
    random = np.random.default_rng(rng)
    worst = 0.0
    for _ in range(draws):
        x = random.standard_normal(operator.input_shape)
        y = random.standard_normal(operator.output_shape)
        there = np.asarray(operator.forward(x.copy()), np.float64)
        back = np.asarray(operator.adjoint(y.copy()), np.float64)
        for name, array, shape in (("forward", there, y.shape), ("adjoint", back, x.shape)):
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(
                    f"{name}: expected a finite array of shape {shape}, got shape {array.shape}"
                    + (" with NaN or infinity" if array.shape == shape else "")
                )
        size = _length(there) * _length(y) + _length(x) * _length(back)
        difference = abs(float(np.vdot(there, y)) - float(np.vdot(x, back)))
        worst = max(worst, float(difference / size) if size else 0.0)
    if worst > tol:
        raise ValueError(
            f"adjoint: expected ⟨G x, y⟩ = ⟨x, Gᵀ y⟩, got a relative difference of {worst:.2g}, "
            f"which is above tol = {tol:g}"
        )
    return worst


def dot(a: Array, b: Array) -> float:
    """Give ⟨a, b⟩, without BLAS, whose threads would stand in the way of the engine's."""
    return float(np.einsum("i,i->", a.ravel(), b.ravel()))


def _pixels(shape: Sequence[int]) -> tuple[int, ...]:
    sizes = tuple(index(size) for size in shape)
    if len(sizes) not in (1, 2) or min(sizes) < 1:
        raise ValueError(f"shape: expected (H, W) or (N,), none of it 0, got {sizes}")
    return sizes


def _giving(shape: tuple[int, ...], name: str, function: Function) -> Function:
    """Check what a function gives, so that an operator's mistake shows where it is made."""

    def checked(array: Array) -> Array:
        return _fitting(f"what {name} gives", function(array), tuple(shape))

    return checked


def _length(array: Array) -> float:
    return float(np.linalg.norm(array.ravel()))


def _fitting(name: str, array: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    values = np.require(array, np.float64, ["C", "ALIGNED"])
    if values.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {values.shape}")
    return values
