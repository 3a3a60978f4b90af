"""The linear step of ADMM: its normal equations, solved in the basis of the cosine transform.

All arrays are those of a stack of images, which do not affect each other.

The image is mirrored at its border. The discrete cosine transform therefore diagonalizes DᵀD
exactly, and also AᵀA if the kernel is symmetric about its pixel.
"""

import contextlib
import os
import threading
from collections.abc import Callable, Sequence

import numpy as np

from jotlight.array_types import Array
from jotlight.interrupts import interruptible
from jotlight.sensing.data.stacks import dots, each_image
from jotlight.sensing.likelihood.operators import Operator, Scaling, Spread, differences, spread

_LARGE = 1 << 20
"""Number of values from which a cosine transform takes long enough for Ctrl-C to matter."""

_MAX_CG_STEPS = 50
"""The maximum number of steps of conjugate gradients."""

_POOL = threading.RLock()
"""Lock for SciPy's pool of threads. A fork stops the pool, so it waits for running transforms."""

if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_POOL.acquire, after_in_parent=_POOL.release, after_in_child=_POOL.release
    )


class NormalEquations:
    """The equations (ρ₁ AᵀA + ρ₂ DᵀD + ρ₃) c = r for each image c of a stack.

    Parameters
    ----------
    operator : Operator
        A, from the image to the light on the cells.
    tol : float
        Conjugate gradients stop when the norm of the residual is `tol` ‖r‖. They run only if the
        cosine transform does not diagonalize AᵀA.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> from jotlight.sensing.likelihood.operators import scaling
    >>> equations = NormalEquations(scaling((4, 4), 2.0), 1e-6, None)
    >>> one = np.ones(1)
    >>> image = equations.solve(np.ones((1, 4, 4)), [one, one], np.zeros((1, 4, 4)))
    >>> bool(np.allclose(image, 0.25))  # 1/2², since the image is constant
    True
    """

    def __init__(self, operator: Operator, tol: float, threads: int | None) -> None:
        shape = operator.input_shape
        self._operator, self._tol = operator, tol
        self._diagonal = isinstance(operator, Scaling) or (
            isinstance(operator, Spread) and operator.symmetric
        )
        self._workers = threads or os.cpu_count() or 1
        self._ones = np.ones(operator.output_shape)
        self._differences = differences(shape, threads=threads)
        self._laplacian = np.zeros((1,) * len(shape))
        for axis, size in enumerate(shape):
            eigenvalues = 2 - 2 * np.cos(np.pi * np.arange(size) / size)
            self._laplacian = self._laplacian + _along(axis, len(shape), eigenvalues)
        self._gram = _gram_eigenvalues(operator)
        self.gain = float(np.sqrt(np.max(self._gram)))
        """√‖AᵀA‖: the norm of the light per pixel, for a constant image of intensity 1."""

    def solve(self, right: Array, penalties: Sequence[Array], guess: Array) -> Array:
        """Return c for the right-hand side r.

        Parameters
        ----------
        right : ndarray of float64, shape (N, ...)
            r of each image.
        penalties : sequence of ndarray of float64, shape (N,)
            ρ₁ of the data, ρ₂ of the differences and, optionally, ρ₃ of the box, of each image.
        guess : ndarray of float64, shape (N, ...)
            The images at which conjugate gradients start.
        """
        data, variation, *box = (each_image(penalty, right) for penalty in penalties)
        eigenvalues = data * self._gram + variation * self._laplacian + sum(box)
        if self._diagonal:
            return self._divide(right, eigenvalues)

        def multiply(image: Array) -> Array:
            light = self._operator.normal(self._ones, image)
            curvature = self._differences.adjoint(self._differences.forward(image))
            return data * light + variation * curvature + sum(box) * image

        # These are conjugate gradients, preconditioned by the approximate diagonal form. SciPy's cg
        # takes the same steps, but its scalar products start BLAS threads, which compete with the
        # threads of the engine.
        solution, residual = guess, right - multiply(guess)
        limit = self._tol**2 * dots(right, right)
        search, norm = np.zeros_like(right), np.ones(len(right))
        for _ in range(_MAX_CG_STEPS):
            unfinished = dots(residual, residual) > limit
            if not unfinished.any():
                break
            divided = self._divide(residual, eigenvalues)
            norm, previous_norm = np.where(unfinished, dots(residual, divided), 1.0), norm
            # Images that have ended keep a search direction and a step of 0.
            divided *= each_image(unfinished, divided)
            ratio = np.where(unfinished, norm / previous_norm, 0.0)
            search = divided + each_image(ratio, search) * search
            product = multiply(search)
            step = each_image(norm / np.where(unfinished, dots(search, product), np.inf), search)
            solution = solution + step * search
            residual = residual - step * product
        return solution

    def _divide(self, right: Array, eigenvalues: Array) -> Array:
        from scipy.fft import dctn, idctn

        spectrum = self._transform(dctn, right)
        spectrum /= eigenvalues
        return self._transform(idctn, spectrum, overwrite_x=True)

    def _transform(self, function: Callable[..., Array], array: Array, **options: bool) -> Array:
        def use_library() -> Array:
            # A single worker does not use the pool.
            axes = range(1, array.ndim)
            with contextlib.nullcontext() if self._workers == 1 else _POOL:
                return function(array, axes=axes, norm="ortho", workers=self._workers, **options)

        return interruptible(use_library)() if array.size > _LARGE else use_library()


def _gram_eigenvalues(operator: Operator) -> Array:
    """Return the eigenvalues of AᵀA, which are approximate unless the kernel is symmetric."""
    from scipy.fft import dct

    shape = operator.input_shape
    if isinstance(operator, Scaling):
        return np.full((1,) * len(shape), operator.factor**2)
    if not isinstance(operator, Spread):
        ones = np.ones(shape)
        return np.full((1,) * len(shape), operator.adjoint(operator.forward(ones)).mean())
    eigenvalues = np.full((1,) * len(shape), operator.gain**2)
    for axis, size in enumerate(shape):
        line = spread((size,), operator.oversampling, operator.kernel)
        impulse = np.zeros(size)
        impulse[0] = 1
        response = line.normal(np.ones(line.output_shape), impulse)
        ratio = np.maximum(dct(response) / dct(impulse), 0)
        eigenvalues = eigenvalues * _along(axis, len(shape), ratio)
    return eigenvalues


def _along(axis: int, dimensions: int, values: Array) -> Array:
    """Return `values` as an array that broadcasts along one axis."""
    shape = [1] * dimensions
    shape[axis] = len(values)
    return values.reshape(shape)
