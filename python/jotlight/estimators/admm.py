"""Maximum likelihood with total variation, by ADMM: the paper's reference [7]."""

import abc
import functools
import os
from collections.abc import Iterable
from typing import Literal, overload

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.estimators.convergence import Callback, ConvergenceHistory, ConvergenceMonitor
from jotlight.estimators.problem import ConvergenceHistories, solve_channels
from jotlight.estimators.tv import automatic_weight, check_map, check_norm, total_variation
from jotlight.sensing.bits import Bits
from jotlight.sensing.likelihood import Array, Problem
from jotlight.sensing.operators import Operator, Scaling, Spread, differences, dot, spread
from jotlight.sensing.sensor import Sensor

Picture = npt.NDArray[np.float32]

_RELAXATION = 1.7
"""Over-relaxation, as Eckstein and Bertsekas (1992) advise: 1.5 to 1.8."""

_STIFF = 6.0
"""The penalty on the differences to begin with, in units of the weight over the mean intensity."""

_STIFF_JOTS = 3.0
"""The penalty on the light to begin with, in units of the information, where the cells are jots."""

_BALANCE = 0.1
"""The primal residual counts as much as this share of the dual one."""

_PATIENCE = 10
"""Iterations between two looks at the balance of the residuals."""

_DARK = 1e-3
"""A picture darker than this share of S is measured by it, since no share of nothing is small."""

_WEAK = 0.1
"""The share of the likelihood's stiffness that counts as a force in any case."""

_UNLIT = 1e-6
"""The share of the brightest light that stands for none where there must be some."""

_CALMING = 0.8
"""Each change of the penalties is to this power of the one before."""

_CG_STEPS = 50
_CG_ENOUGH = 1e-6


@overload
def admm_tv(
    data: Bits | Problem | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    weight: float | npt.ArrayLike | None = ...,
    norm: str = ...,
    start: npt.ArrayLike | None = ...,
    max_iter: int = ...,
    tol: float = ...,
    callback: Callback | None = ...,
    return_history: Literal[False] = ...,
    threads: int | None = ...,
) -> Picture: ...


@overload
def admm_tv(
    data: Bits | Problem | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    weight: float | npt.ArrayLike | None = ...,
    norm: str = ...,
    start: npt.ArrayLike | None = ...,
    max_iter: int = ...,
    tol: float = ...,
    callback: Callback | None = ...,
    return_history: Literal[True],
    threads: int | None = ...,
) -> tuple[Picture, ConvergenceHistories]: ...


def admm_tv(
    data: Bits | Problem | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    weight: float | npt.ArrayLike | None = None,
    norm: str = "isotropic",
    start: npt.ArrayLike | None = None,
    max_iter: int = 500,
    tol: float = 1e-3,
    callback: Callback | None = None,
    return_history: bool = False,
    threads: int | None = None,
) -> Picture | tuple[Picture, ConvergenceHistories]:
    """Find the image in [0, S] with the least -ℓ(c) + λ TV(c), likely and without needless change.

    Parameters
    ----------
    data : Bits, array_like of int, or Problem
        Bits, or an image of counts L of shape (H, W) or (H, W, C), which serves for the box
        kernel, whose single jots are never looked at; or a problem of your own, for signals (N,)
        and other operators, without a sensor.
    sensor : Sensor
        What made the data.
    weight : float or array_like of float, optional
        λ ≥ 0 in nats per unit of intensity, a number or one for each pixel. Default: chosen from
        the data by :func:`jotlight.estimators.tv.automatic_weight`, which says how.
    norm : {"isotropic", "anisotropic"}
        TV is the sum over pixels of √(down² + right²), or of abs(down) + abs(right).
    start : array_like of float, optional
        Where to begin, of the picture's shape; one near the result saves a few rounds. Default:
        the same intensity everywhere.
    max_iter : int
        Iterations at most; a JotlightWarning says when they were not enough.
    tol : float
        The run ends when the primal residual is at most `tol` and the dual one at most 10 `tol`,
        each as a share of what it is the difference of.
    callback : callable, optional
        Called with a :class:`jotlight.estimators.convergence.Iteration` after each; raises StopIteration to
        end the run.
    return_history : bool
        Give a :class:`jotlight.estimators.convergence.ConvergenceHistory` too, or a list of them, one for each channel.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    ndarray of float32, shape (H, W) or (H, W, C)
        Intensities in [0, S]. With `return_history` a tuple of it and the history.

    Raises
    ------
    TypeError, ValueError
        When data, sensor and start do not fit, or a parameter is out of its range.

    Warns
    -----
    JotlightWarning
        When the run did not converge.

    Notes
    -----
    The alternating direction method of multipliers on A c = s, D c = v and, where the cells are
    jots, c = w in [0, S] (Chan and Lu 2014; residuals and their stopping rule as in Boyd et al.
    2011, section 3.3; penalties balanced as by Wohlberg 2017). The step in s is a scalar problem
    for each cell, that in v a shrinkage; that in c is diagonal in the cosine basis, but for a few
    steps of conjugate gradients where K̂ and the kernel's degree are both odd.

    Pixels without a valid jot take part: total variation alone says what they are.

    Examples
    --------
    >>> sensor = Sensor(oversampling=4)
    >>> scene = np.where(np.arange(32)[:, None] < 16, 0.2, 0.7) * np.ones((32, 32))
    >>> picture, history = admm_tv(sensor.expose(scene, rng=0), sensor, return_history=True)
    >>> history.converged, bool(abs(picture - scene).mean() < 0.05)
    (True, True)
    """
    check_norm(norm)
    if weight is not None:
        check_map("weight", weight, np.shape(weight))
    ConvergenceMonitor("admm_tv", max_iter, tol, None)  # what is wrong with them is said at once

    def solve(
        problem: Problem, begin: Array | None, channel: str
    ) -> tuple[Array, ConvergenceHistory]:
        watch = ConvergenceMonitor("admm_tv" + channel, max_iter, tol, callback)
        chosen = automatic_weight(problem, norm=norm) if weight is None else weight
        return _minimise(problem, np.asarray(chosen), norm, begin, watch, threads)

    picture, history = solve_channels(solve, data, sensor, start, threads)
    return (picture, history) if return_history else picture


class _Term(abc.ABC):
    """A term f(A c) of the objective: f(x) with x = A c, and the penalty ½ ρ ‖A c - x + dual‖²."""

    def __init__(self, penalty: float, x: Array, dual: Array) -> None:
        self.penalty, self.x, self.dual = penalty, x, dual
        self._back = self.adjoint(x)
        self._back_dual = self.adjoint(dual)

    @abc.abstractmethod
    def adjoint(self, array: Array) -> Array:
        """Give Aᵀ of an array like x."""

    @abc.abstractmethod
    def split(self, image: Array) -> float:
        """Move x and the dual on; give the primal residual, squared, in units of intensity."""

    def update(self, image: Array) -> tuple[float, Array]:
        """Move x and the dual on; give the primal residual, squared, and the dual residual."""
        primal = self.split(image)
        before, self._back = self._back, self.adjoint(self.x)
        self._back_dual = self.adjoint(self.dual)
        return primal, self.penalty * (self._back - before)

    def pull(self) -> Array:
        """Give ρ Aᵀ(x - dual), where the term wants c to be."""
        return self.penalty * (self._back - self._back_dual)

    def force(self) -> Array:
        """Give Aᵀ y of the multiplier y = ρ dual."""
        return self.penalty * self._back_dual

    def rescale(self, factor: float) -> None:
        """Change ρ and leave the multiplier as it is."""
        self.penalty *= factor
        self.dual /= factor
        self._back_dual /= factor


class _Data(_Term):
    """-ℓ of the light, which lies between 0 and what S casts."""

    def __init__(
        self, problem: Problem, penalty: float, gain: float, image: Array, threads: int | None
    ) -> None:
        self._operator, self._likelihood = problem.operator, problem.likelihood
        self._gain, self._threads = gain, threads
        brightest = self._operator.forward(np.full(image.shape, problem.max_intensity))
        self.most = float(np.max(brightest))
        light = self._operator.forward(image)
        # Where x is best, ρ dual is the slope of ℓ: a start near the end has its multipliers too,
        # but for cells that a start leaves nearly dark although they fired, whose slope is endless.
        slope, _ = self._likelihood.gradient_and_curvature(light)
        lit = (light > 0) & (light < self.most)
        far = float(light.mean())
        super().__init__(penalty, light, np.where(lit, np.clip(-slope / penalty, -far, far), 0.0))

    def adjoint(self, array: Array) -> Array:
        return self._operator.adjoint(array)

    def split(self, image: Array) -> float:
        light = self._operator.forward(image).reshape(-1)
        return (
            self._likelihood.admm_update(
                (self.penalty, _RELAXATION), self.most, light, self.x, self.dual
            )
            / self._gain**2
        )


class _Variation(_Term):
    """λ TV, of an image (H, W) or, as one row of it, a signal."""

    def __init__(
        self,
        weight: npt.NDArray[np.floating],
        norm: str,
        penalty: float,
        image: Array,
        threads: int | None,
    ) -> None:
        self._weight = check_map("weight", weight, image.shape)
        self._isotropic, self._threads = norm == "isotropic", threads
        self._shape = image.shape
        self._rows = image.shape if image.ndim == 2 else (1, *image.shape)
        self._differences = differences(self._rows, threads=threads)
        planes = self._differences.forward(image.reshape(self._rows))
        # The part of each difference that shrinking takes away.
        dual = planes.copy()
        engine.shrink(dual, self._weight / penalty, self._isotropic, threads)
        super().__init__(penalty, planes, planes - dual)

    def adjoint(self, array: Array) -> Array:
        return self._differences.adjoint(array).reshape(self._shape)

    def split(self, image: Array) -> float:
        return engine.total_variation_admm_update(
            (self.penalty, _RELAXATION),
            self._weight,
            self._isotropic,
            image.reshape(self._rows),
            self.x,
            self.dual,
            self._threads,
        )


class _Box(_Term):
    """0 ≤ c ≤ S, where the light's own range does not say so."""

    def __init__(self, most: float, penalty: float, image: Array) -> None:
        self._most = most
        super().__init__(penalty, image.copy(), np.zeros_like(image))

    def adjoint(self, array: Array) -> Array:
        return array

    def split(self, image: Array) -> float:
        point = _RELAXATION * image + (1 - _RELAXATION) * self.x + self.dual
        self.x = np.clip(point, 0, self._most)
        self.dual = point - self.x
        return _squares(image - self.x)


def _minimise(
    problem: Problem,
    weight: npt.NDArray[np.floating],
    norm: str,
    begin: Array | None,
    watch: ConvergenceMonitor,
    threads: int | None,
) -> tuple[Array, ConvergenceHistory]:
    operator, most = problem.operator, problem.max_intensity
    mean = problem.constant_estimate()
    image = np.full(operator.input_shape, mean) if begin is None else begin
    normal = _Normal(operator, min(_CG_ENOUGH, 0.01 * watch.tol), threads)
    # The likelihood is about as stiff as its information, and so are the penalties.
    light = operator.forward(np.full(operator.input_shape, mean))
    stiffness = float(np.mean(problem.likelihood.information(light)))
    # In a glaring light nearly nothing of it is left; then what the light's own size allows.
    stiffness = max(stiffness, 1e-9 * float(np.mean(problem.likelihood.trials) / light.mean() ** 2))
    stiff = stiffness * normal.gain**2
    differing = max(_STIFF * float(np.mean(weight)) / mean, 1e-2 * stiff)
    variation = _Variation(weight, norm, differing, image, threads)
    if isinstance(operator, Scaling):
        data = _Data(problem, stiffness, normal.gain, image, threads)
        terms: list[_Term] = [data, variation]
    else:
        data = _Data(problem, _STIFF_JOTS * stiffness, normal.gain, image, threads)
        terms = [data, variation, _Box(most, 0.1 * stiff, image)]

    calm = 1.0
    while True:
        right = _sum(term.pull() for term in terms)
        image = normal.solve(right, [term.penalty for term in terms], image)
        apart, moves = zip(*(term.update(image) for term in terms), strict=True)
        primal = _ratio(sum(apart), _squares(image) + image.size * (_DARK * most) ** 2)
        # Without a prior the multipliers vanish; then the likelihood's resistance is the measure.
        forces = sum(_squares(term.force()) for term in terms)
        forces += (_WEAK * stiff) ** 2 * _squares(image)
        dual = _ratio(_squares(_sum(moves)), forces)
        if isinstance(operator, Scaling):
            estimate = np.clip(data.x / operator.factor, 0, most)
        else:
            estimate = terms[-1].x
        residuals = {"primal": primal, "dual": dual}
        if not watch.update(estimate, residuals, {"dual": 1 / _BALANCE}):
            break
        if watch.number % _PATIENCE == 0 and primal > 0 and dual > 0:
            factor = float(np.sqrt(primal / (_BALANCE * dual)))
            if not 0.5 < factor < 2:
                # Less and less, so that the penalties come to rest.
                for term in terms:
                    term.rescale(min(max(factor, 0.25), 4.0) ** calm)
                calm *= _CALMING
    value = problem.log_likelihood(estimate)
    if not np.isfinite(value):
        # A bit is 1 where the light has been rounded to 0.
        light = np.maximum(operator.forward(estimate), _UNLIT * data.most)
        value = problem.likelihood.value(light)
    objective = total_variation(estimate, norm, weight=weight) - value
    return estimate, watch.finish(objective, weight if weight.ndim else float(weight))


class _Normal:
    """Solves (ρ₁ AᵀA + ρ₂ DᵀD + ρ₃) c = r in the cosine basis."""

    def __init__(self, operator: Operator, enough: float, threads: int | None) -> None:
        shape = operator.input_shape
        self._operator, self._enough = operator, enough
        self._exact = isinstance(operator, Scaling) or (
            isinstance(operator, Spread) and operator.symmetric
        )
        self._workers = threads or os.cpu_count() or 1
        self._ones = np.ones(operator.output_shape)
        self._differences = differences(shape, threads=threads)
        self._laplacian = np.zeros((1,) * len(shape))
        for axis, size in enumerate(shape):
            symbol = 2 - 2 * np.cos(np.pi * np.arange(size) / size)
            self._laplacian = self._laplacian + _along(axis, len(shape), symbol)
        self._gram = _gram_symbol(operator)
        self.gain = float(np.sqrt(np.max(self._gram)))
        """The light of a cell, or cells, for an even intensity of 1: √‖AᵀA‖."""

    def solve(self, right: Array, penalties: list[float], guess: Array) -> Array:
        """Give c; `penalties` are those of the data, the differences and, if any, the box."""
        data, differing, *rest = penalties
        symbol = data * self._gram + differing * self._laplacian + sum(rest)
        if self._exact:
            return self._divide(right, symbol)

        def multiply(image: Array) -> Array:
            light = self._operator.normal(self._ones, image)
            planes = self._differences.adjoint(self._differences.forward(image))
            return data * light + differing * planes + sum(rest) * image

        # Conjugate gradients, with the symbol as what they are preconditioned by.
        solution, residual = guess, right - multiply(guess)
        enough = self._enough**2 * _squares(right)
        search, size = np.zeros_like(right), 1.0
        for _ in range(_CG_STEPS):
            if _squares(residual) <= enough:
                break
            divided = self._divide(residual, symbol)
            size, before = dot(residual, divided), size
            search = divided + size / before * search
            product = multiply(search)
            step = size / dot(search, product)
            solution = solution + step * search
            residual = residual - step * product
        return solution

    def _divide(self, right: Array, symbol: Array) -> Array:
        from scipy.fft import dctn, idctn

        spectrum = dctn(right, norm="ortho", workers=self._workers)
        spectrum /= symbol
        return np.asarray(idctn(spectrum, norm="ortho", workers=self._workers, overwrite_x=True))


def _gram_symbol(operator: Operator) -> Array:
    """AᵀA in the cosine basis: exact for a kernel that is even about its pixel, else nearly."""
    from scipy.fft import dct

    shape = operator.input_shape
    if isinstance(operator, Scaling):
        return np.full((1,) * len(shape), operator.factor**2)
    if not isinstance(operator, Spread):
        ones = np.ones(shape)
        return np.full((1,) * len(shape), operator.adjoint(operator.forward(ones)).mean())
    symbol = np.full((1,) * len(shape), operator.gain**2)
    for axis, size in enumerate(shape):
        line = spread((size,), operator.oversampling, operator.kernel)
        impulse = np.zeros(size)
        impulse[0] = 1
        response = line.normal(np.ones(line.output_shape), impulse)
        symbol = symbol * _along(axis, len(shape), np.maximum(dct(response) / dct(impulse), 0))
    return symbol


def _along(axis: int, dimensions: int, values: Array) -> Array:
    shape = [1] * dimensions
    shape[axis] = len(values)
    return values.reshape(shape)


def _ratio(part: float, whole: float) -> float:
    return float(np.sqrt(part / whole)) if whole > 0 else float(part > 0)


def _sum(arrays: Iterable[Array]) -> Array:
    return functools.reduce(np.add, arrays)


def _squares(array: Array) -> float:
    return dot(array, array)
