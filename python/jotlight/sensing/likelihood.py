"""The likelihood of bits, and what is to be maximised: equation (4), for any threshold."""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import refuse_masked
from jotlight.chunks import pixel_chunks
from jotlight.sensing.operators import Operator

Array = npt.NDArray[np.float64]

_AT_ONCE = 1 << 21
"""Cells that the engine handles between two looks at Ctrl-C."""


class Likelihood:
    """ℓ(s) = Σ L log P(q, η s + d) + (n - L) log(1 - P(q, η s + d)), as a function of the light.

    Parameters
    ----------
    ones : array_like of int, any shape
        L: how many bits of each cell are 1. A cell is a jot, or a pixel whose jots all see the
        same light.
    trials : int or array_like of int
        n: how many bits each cell has, or a map of them; 0 for a cell that is dead.
    threshold : int
        q: photons that make a bit 1.
    efficiency : float or array_like of float
        η of each cell in (0, 1]: the share of its light that is detected, a number or a map.
    dark_counts : float or array_like of float
        d of each cell: detections without light, a number or a map.
    threads : int, optional
        Threads to use. Default: all.

    Raises
    ------
    TypeError, ValueError
        When the arrays do not fit, or a count is below 0 or above n.

    Notes
    -----
    ℓ is concave. Its logarithms and slopes are accurate to eleven digits (for q in the ten
    thousands nine) for η s from 1e-12 to 1e4; at η s + d = 0 the value is -inf where a bit is 1.

    Examples
    --------
    >>> seen = Likelihood([3, 0], trials=4)
    >>> round(seen.value([1.0, 0.5]), 6)  # 3 log(1 - 1/e) - 1 - 4/2
    -4.376025
    >>> gradient, curvature = seen.gradient_and_curvature([1.0, 0.5])
    >>> gradient.round(6).tolist(), curvature.round(6).tolist()
    ([0.74593, -4.0], [2.762021, 0.0])
    """

    def __init__(
        self,
        ones: npt.ArrayLike,
        trials: int | npt.ArrayLike = 1,
        *,
        threshold: int = 1,
        efficiency: float | npt.ArrayLike = 1.0,
        dark_counts: float | npt.ArrayLike = 0.0,
        threads: int | None = None,
    ) -> None:
        self.ones = _whole("ones", ones)
        self.shape = self.ones.shape
        if self.ones.size == 0:
            raise ValueError(f"ones: expected at least one cell, got shape {self.shape}")
        self.trials = _map_or_number("trials", _whole("trials", trials), self.shape)
        refuse_masked("dark_counts", dark_counts)
        dark = np.asarray(dark_counts)
        if dark.dtype.kind not in "iuf" or not (np.isfinite(dark) & (dark >= 0)).all():
            raise ValueError(
                f"dark_counts: expected finite numbers, 0 or more, got {dark_counts!r}"
            )
        self.dark_counts = _map_or_number(
            "dark_counts", np.require(dark, np.float64, ["C", "ALIGNED"]), self.shape
        )
        refuse_masked("efficiency", efficiency)
        share = np.asarray(efficiency)
        if share.dtype.kind not in "iuf" or not ((share > 0) & (share <= 1)).all():
            raise ValueError(f"efficiency: expected numbers in (0, 1], got {efficiency!r}")
        self.efficiency = _map_or_number(
            "efficiency", np.require(share, np.float64, ["C", "ALIGNED"]), self.shape
        )
        self.threshold = threshold
        self._threads = threads
        if not 1 <= threshold <= 65535 or threshold != int(threshold):
            raise ValueError(
                f"threshold: expected a whole number from 1 to 65535, got {threshold!r}"
            )
        excess = self.ones - self.trials
        if self.ones.min() < 0 or excess.max() > 0:
            raise ValueError(
                f"ones: expected 0 to as many as there are trials, got {self.ones.min()} to "
                f"{self.ones.max()} with up to {np.max(self.trials)} trials"
            )

    def value(self, light: npt.ArrayLike) -> float:
        """ℓ, in nats, at the light s of all cells."""
        flat = self._light(light).reshape(-1)
        return sum(
            engine.log_likelihood(self._seen(part), flat[part], self._threads)
            for part in pixel_chunks(flat.size, _AT_ONCE)
        )

    def gradient_and_curvature(self, light: npt.ArrayLike) -> tuple[Array, Array]:
        """∂ℓ/∂s and the curvature -∂²ℓ/∂s² ≥ 0 of each cell."""
        flat = self._light(light).reshape(-1)
        gradient, curvature = np.empty(flat.size), np.empty(flat.size)
        for part in pixel_chunks(flat.size, _AT_ONCE):
            engine.likelihood_gradient_and_curvature(
                self._seen(part), flat[part], gradient[part], curvature[part], self._threads
            )
        return gradient.reshape(self.shape), curvature.reshape(self.shape)

    def information(self, light: npt.ArrayLike) -> Array:
        """Give the Fisher information n (η P')² / (P (1 - P)) of each cell about its light.

        It is the curvature that the bits have on average, and its inverse the least variance of
        an unbiased estimate.

        Examples
        --------
        >>> Likelihood([1], trials=16).information(1.0).round(4).tolist()  # 16 / (e - 1)
        [9.3116]
        """
        flat = self._light(light).reshape(-1)
        information = np.empty(flat.size)
        for part in pixel_chunks(flat.size, _AT_ONCE):
            engine.likelihood_information(
                self._seen(part), flat[part], information[part], self._threads
            )
        return information.reshape(self.shape)

    def proximal(
        self,
        point: npt.ArrayLike,
        penalty: float,
        *,
        max_light: float,
        guess: npt.ArrayLike | None = None,
    ) -> Array:
        """Return the x in [0, `max_light`] that minimizes -ℓ(x) + ½ `penalty` ‖x - point‖².

        `guess` is where the search begins; a good one saves time and changes nothing else.

        Examples
        --------
        >>> Likelihood([2], trials=4).proximal([0.5], 1e9, max_light=2.0).round(6).tolist()
        [0.5]
        """
        if not 0 < penalty < np.inf or not 0 < max_light < np.inf:
            raise ValueError(
                f"penalty and max_light: expected finite numbers above 0, got {penalty} and {max_light}"
            )
        # A copy, which the engine turns into the result.
        flat = np.array(self._fitting("point", point)).reshape(-1)
        if np.isnan(flat).any():
            raise ValueError("point: expected numbers, got NaN")
        start = flat.copy() if guess is None else self._light(guess, "guess").reshape(-1)
        for part in pixel_chunks(flat.size, _AT_ONCE):
            engine.likelihood_proximal(
                self._seen(part), penalty, max_light, start[part], flat[part], self._threads
            )
        return flat.reshape(self.shape)

    def admm_update(
        self, step: tuple[float, float], most: float, light: Array, x: Array, dual: Array
    ) -> float:
        """Make a step of ADMM, (penalty, relaxation), on x and its dual; give ‖light - x‖²."""
        x, dual = x.reshape(-1), dual.reshape(-1)
        return sum(
            engine.likelihood_admm_update(
                self._seen(part), step, most, light[part], x[part], dual[part], self._threads
            )
            for part in pixel_chunks(x.size, _AT_ONCE)
        )

    def _light(self, light: npt.ArrayLike, name: str = "light") -> Array:
        array = self._fitting(name, light)
        if not array.min() >= 0:
            raise ValueError(f"{name}: expected 0 or more, got {array.min()}")
        return array

    def _fitting(self, name: str, values: npt.ArrayLike) -> Array:
        try:
            array = np.broadcast_to(np.asarray(values, np.float64), self.shape)
        except ValueError:
            raise ValueError(
                f"{name}: expected shape {self.shape}, got {np.shape(values)}"
            ) from None
        return np.require(array, np.float64, ["C", "ALIGNED"])

    def _seen(self, part: slice) -> tuple[int, Any, Any, Any, Any]:
        return (
            int(self.threshold),
            self.ones.reshape(-1)[part],
            _cut(self.trials, part),
            _cut(self.efficiency, part),
            _cut(self.dark_counts, part),
        )


@dataclasses.dataclass(frozen=True)
class Problem:
    """Maximise ℓ(A c) over images c in [0, S]: equation (4).

    Parameters
    ----------
    operator : Operator
        A, from the image to the light of the likelihood's cells, without negative entries;
        :func:`jotlight.sensing.operators.spread` or one of your own.
    likelihood : Likelihood
        Of what the cells saw.
    max_intensity : float
        S.

    Raises
    ------
    ValueError
        When the operator's light is not that of the likelihood's cells, or no cell has a bit.

    Examples
    --------
    A signal on a line of jots, 6 to a pixel, its light spread by a cubic kernel:

    >>> from jotlight import mle_iterative, operators
    >>> light = operators.spread((20,), oversampling=6, kernel="cubic", gain=6.0)
    >>> ramp = np.linspace(0.2, 0.8, 20)
    >>> chance = -np.expm1(-light.forward(ramp))
    >>> ones = np.random.default_rng(0).binomial(100, chance)
    >>> estimate = mle_iterative(Problem(light, Likelihood(ones, trials=100)))
    >>> estimate.shape, bool(abs(estimate - ramp).max() < 0.3)
    ((20,), True)
    """

    operator: Operator
    likelihood: Likelihood
    max_intensity: float = 1.0

    def __post_init__(self) -> None:
        if self.operator.output_shape != self.likelihood.shape:
            raise ValueError(
                f"operator: expected light of the bits' shape {self.likelihood.shape}, "
                f"got {self.operator.output_shape}"
            )
        if np.max(self.likelihood.trials) == 0:
            raise ValueError("trials: expected at least one cell with a bit, got none")
        if not 0 < self.max_intensity < np.inf:
            raise ValueError(
                f"max_intensity: expected a finite number above 0, got {self.max_intensity!r}"
            )

    def constant_estimate(self) -> float:
        """Give the intensity that would make as many bits fire as did, were it the same everywhere.

        It is kept from 0 and from S, so that an iterative method can begin there.
        """
        seen = self.likelihood
        trials = np.broadcast_to(np.asarray(seen.trials, np.float64), seen.shape)
        share = float(seen.ones.sum() / max(trials.sum(), 1.0))
        rate = engine.inverse_detection_probability(int(seen.threshold), share)
        if not trials.any():
            trials = np.ones(seen.shape)
        dark = np.average(np.broadcast_to(seen.dark_counts, seen.shape), weights=trials)
        light = np.average(
            seen.efficiency * self.operator.forward(np.ones(self.operator.input_shape)),
            weights=trials,
        )
        most = self.max_intensity
        return float(np.clip((rate - dark) / light, 1e-3 * most, 0.9 * most))

    def log_likelihood(self, image: npt.ArrayLike) -> float:
        """ℓ(A c) in nats."""
        return self.likelihood.value(self.operator.forward(np.asarray(image, np.float64)))


def _whole(name: str, values: npt.ArrayLike) -> npt.NDArray[np.int32]:
    refuse_masked(name, values)
    array = np.asarray(values)
    if array.dtype.kind not in "iub":
        raise TypeError(f"{name}: expected whole numbers, got {array.dtype}")
    if array.size and (array.min() < 0 or array.max() >= 2**31):
        raise ValueError(f"{name}: expected 0 to 2**31 - 1, got {array.min()} to {array.max()}")
    return np.require(array, np.int32, ["C", "ALIGNED"])


def _map_or_number(name: str, array: npt.NDArray[Any], shape: tuple[int, ...]) -> Any:
    if array.ndim == 0:
        return array.item()
    if array.shape != shape:
        raise ValueError(f"{name}: expected a number or shape {shape}, got {array.shape}")
    return array


def _cut(value: Any, part: slice) -> Any:
    return value.reshape(-1)[part] if isinstance(value, np.ndarray) else value
