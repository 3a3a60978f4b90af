"""How the displacements of tiles probably deviate from a motion: smoothly in space and in time.

It is not known before how a scene deforms, but neighboring tiles move similarly, and each tile
moves smoothly. So the prior of the deviations is Gaussian with mean 0, for rows and columns alike.
Deviations are sums of *modes*: products of a curve in time and cosines in space, with independent
coefficients. The bits decide how large the coefficients of similar modes are: their variances are
those under which the bits are most probable. So if a scene does not deform, its deviations become
small.
"""

import dataclasses
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.motion.displacements.track import Track

_DEVIATION = 8.0
"""Standard deviation of the displacement by a constant velocity over the time of the burst, in
pixels."""

_BENDING = 30.0
"""Variance of the change of this velocity in the time of the burst, relative to that of the
velocity."""

_OFFSET = 0.1
"""Variance of the displacement at the reference time, relative to that of the velocity.

It is 0 for the image at this time, but the template shows the mean of all blocks.
"""

_LENGTH = 2.0
"""Length in tiles over which deviations change."""

_MIN_VARIANCE = 1e-5
"""Variance of a curve in time, relative to the largest one, below which it is left out."""

_BAND = 0.4
"""Width of a band of modes with similar cosines, in radians per tile."""

_ROUNDS = 6
"""Number of rounds that search for the variances of modes."""

_MAX_FACTOR = 10.0
"""Maximum factor by which a round multiplies or divides a variance."""

_DEVIATION_LIMITS = 1e-3, 1e3
"""Limits of the standard deviations of modes, in units of the largest one at first."""

_HALF = 0.5
"""Added to squares and to degrees of freedom, so that modes without information keep theirs."""

_MAX_STEPS = 200
"""Maximum number of steps of conjugate gradients."""

_TOLERANCE, _COARSE_TOLERANCE = 1e-3, 1e-2
"""Relative residual at which they end: for deviations, and for degrees of freedom."""


@dataclasses.dataclass(frozen=True)
class DeformationPrior:
    """The modes of the deviations of all tiles in all blocks.

    Coefficients have unit variance, and their shape is (m, 2, rows, columns).
    """

    in_time: Array
    """Curves, (n, m)."""
    at_reference: Array
    """The curves at the reference time, (m,)."""
    along: tuple[Array, Array]
    """Cosines along rows and columns of tiles, (rows, rows) and (columns, columns)."""
    sizes: Array
    """Standard deviations of the products of curves and cosines in pixels, (m, rows, columns)."""

    @classmethod
    def of_track(cls, track: Track) -> Self:
        """Return the prior of the tiles and blocks of a track, before its bits are known."""
        shape = track.nodes.shape[2], track.nodes.shape[3]
        times = (track.blocks.centers - track.reference) / len(track.blocks.burst)
        curves = _curves(np.append(times, 0.0))
        sizes = np.tile(_sizes(shape), (curves.shape[1], 1, 1))
        return cls(curves[:-1], curves[-1], (_cosines(shape[0]), _cosines(shape[1])), sizes)

    @classmethod
    def of_fields(cls, number: int, shape: tuple[int, int], deviation: float) -> Self:
        """Return the prior of independent fields of tiles, whose rows and columns have a shape.

        `deviation` is the standard deviation of the displacement of a tile in pixels.
        """
        sizes = np.tile(_sizes(shape) * (deviation / _DEVIATION), (number, 1, 1))
        along = _cosines(shape[0]), _cosines(shape[1])
        return cls(np.eye(number), np.zeros(number), along, sizes)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """The shape of coefficients, (m, 2, rows, columns)."""
        number, rows, columns = self.sizes.shape
        return number, 2, rows, columns

    def deviations(self, coefficients: Array) -> Array:
        """Return the deviations of all blocks from the template, (n, 2, rows, columns)."""
        return np.asarray(np.tensordot(self.in_time, self._fields(coefficients), 1))

    def displacements(self, coefficients: Array) -> Array:
        """Return the deviations of all blocks, which are 0 at the reference time."""
        from_reference = self.in_time - self.at_reference
        return np.asarray(np.tensordot(from_reference, self._fields(coefficients), 1))

    def pull_back(self, deviations: Array) -> Array:
        """Return the coefficients of the adjoint of :meth:`deviations`."""
        fields = np.tensordot(self.in_time.T, deviations, 1)
        return np.asarray(self.sizes[:, None] * (self.along[0].T @ fields @ self.along[1]))

    def _fields(self, coefficients: Array) -> Array:
        """Return the fields (m, 2, rows, columns) by which the curves are multiplied."""
        return np.asarray(self.along[0] @ (self.sizes[:, None] * coefficients) @ self.along[1].T)


@dataclasses.dataclass(frozen=True)
class Measurement:
    """What the bits tell about deviations d: minus the log-likelihood is ½ dᵀA d - bᵀd."""

    information: Array
    """A of each block and tile, (n, 3, rows, columns): for rows, for both, and for columns."""
    right: Array
    """b of each block and tile, (n, 2, rows, columns)."""

    def products(self, deviations: Array) -> Array:
        """Return A d, (n, 2, rows, columns)."""
        of_rows, mixed, of_columns = np.moveaxis(self.information, 1, 0)
        rows, columns = np.moveaxis(deviations, 1, 0)
        return np.stack([of_rows * rows + mixed * columns, mixed * rows + of_columns * columns], 1)


def solve_deviations(prior: DeformationPrior, measurement: Measurement, start: Array) -> Array:
    """Return the most probable coefficients. The search begins at others."""
    return _solve(prior, measurement, measurement.right, start, _TOLERANCE)


def with_likely_sizes(
    prior: DeformationPrior, measurement: Measurement, coefficients: Array
) -> tuple[DeformationPrior, Array]:
    """Return the prior under which a measurement is most probable, and the coefficients then.

    Modes have the same factor if their cosines have similar wavelengths, and if they have the same
    curve. The squared coefficients are compared with their degrees of freedom, which they equal on
    average at the maximum of the probability (MacKay 1992).

    Parameters
    ----------
    prior : DeformationPrior
        A prior with larger or smaller modes.
    measurement : Measurement
        The measurement.
    coefficients : ndarray of float, shape (m, 2, rows, columns)
        The most probable coefficients under this prior.
    """
    bands = _bands(prior.sizes.shape[1:])
    low, high = (limit * prior.sizes.max() for limit in _DEVIATION_LIMITS)
    for _ in range(_ROUNDS):
        squares = (coefficients**2).sum(axis=1)
        freedom = _freedom_of_modes(prior, measurement).sum(axis=1)
        of_bands = _ratios(_sum_bands(squares, bands), _sum_bands(freedom, bands))[bands]
        of_curves = _ratios(squares.sum(axis=(1, 2)), freedom.sum(axis=(1, 2)))
        of_curves /= _ratios(squares.sum(), freedom.sum())
        sizes = prior.sizes * np.sqrt(of_curves[:, None, None] * of_bands)
        sizes = np.clip(sizes, low, high)
        start = coefficients * (prior.sizes / sizes)[:, None]
        prior = dataclasses.replace(prior, sizes=sizes)
        coefficients = solve_deviations(prior, measurement, start)
    return prior, coefficients


def degrees_of_freedom(prior: DeformationPrior, measurement: Measurement) -> float:
    """Return how many coefficients the bits determine, rather than the prior.

    It is the trace of B (B + 1)⁻¹, with the information B about the coefficients.
    """
    return float(_freedom_of_modes(prior, measurement).sum())


def gain_of_deviations(prior: DeformationPrior, measurement: Measurement) -> float:
    """Return by how much deviations explain the bits better, as twice the log-likelihood in nats.

    The most probable ones are shrunk, so noise alone gains their degrees of freedom on average.
    """
    coefficients = solve_deviations(prior, measurement, np.zeros(prior.shape))
    return float((prior.pull_back(measurement.right) * coefficients).sum())


def _freedom_of_modes(prior: DeformationPrior, measurement: Measurement) -> Array:
    """Return estimated degrees of freedom of all coefficients, whose sums are about right.

    With a vector s of random signs, the expected value of s B (B + 1)⁻¹ s is the trace.
    """
    signs = np.random.default_rng(0).choice([-1.0, 1.0], prior.shape)
    right = measurement.products(prior.deviations(signs))
    return signs * _solve(prior, measurement, right, np.zeros(prior.shape), _COARSE_TOLERANCE)


def _sum_bands(values: Array, bands: npt.NDArray[np.intp]) -> Array:
    """Return the sums over the modes of each band."""
    return np.bincount(bands.ravel(), values.sum(axis=0).ravel()).astype(np.float64)


def _ratios(squares: Array, freedom: Array) -> Array:
    """Return the factors of variances: squares relative to the degrees of freedom."""
    ratios = (squares + _HALF) / (np.maximum(freedom, 0) + _HALF)
    return np.clip(ratios, 1 / _MAX_FACTOR, _MAX_FACTOR)


def _solve(
    prior: DeformationPrior, measurement: Measurement, right: Array, start: Array, tolerance: float
) -> Array:
    """Return the coefficients z that solve (B + 1) z = Mᵀ b, for other right sides b.

    M is the matrix of :meth:`DeformationPrior.deviations`, and B = Mᵀ A M. Conjugate gradients find
    them.
    """

    def multiply(coefficients: Array) -> Array:
        products = measurement.products(prior.deviations(coefficients))
        return coefficients + prior.pull_back(products)

    target = prior.pull_back(right)
    enough = tolerance**2 * float((target**2).sum())
    solution = start.copy()
    residual = target - multiply(solution)
    direction, squared = residual.copy(), float((residual**2).sum())
    for _ in range(_MAX_STEPS):
        if squared <= enough:
            break
        product = multiply(direction)
        length = squared / float((direction * product).sum())
        solution += length * direction
        residual -= length * product
        before, squared = squared, float((residual**2).sum())
        direction = residual + squared / before * direction
    return solution


def _curves(times: Array) -> Array:
    """Return a square root of the covariance of displacements at times from the reference, (n, m).

    The velocity changes by a random walk, so the most probable curve is a cubic spline.
    """
    first, second = abs(times)[:, None], abs(times)
    near, far = np.minimum(first, second), np.maximum(first, second)
    product = times[:, None] * times
    bending = np.where(product > 0, near**2 * (3 * far - near) / 6, 0)
    variances, vectors = np.linalg.eigh(product + _BENDING * bending + _OFFSET)
    used = variances > _MIN_VARIANCE * variances[-1]
    return np.asarray(vectors[:, used] * np.sqrt(variances[used]))


def _cosines(number: int) -> Array:
    """Return the orthonormal cosines of a number of tiles, as columns."""
    places = np.pi * (np.arange(number) + 0.5) / number
    cosines = np.sqrt(2 / number) * np.cos(places[:, None] * np.arange(number))
    cosines[:, 0] /= np.sqrt(2)
    return np.asarray(cosines)


def _sizes(shape: tuple[int, int]) -> Array:
    """Return the standard deviations of the cosines. The mean variance of a tile is that of time.

    They are those of the solution of (1 - ℓ²Δ) d = white noise, with the length ℓ.
    """
    sizes = 1 / (1 + (_LENGTH * _wavenumbers(shape)) ** 2)
    return np.asarray(_DEVIATION * sizes / np.sqrt((sizes**2).mean()))


def _bands(shape: tuple[int, ...]) -> npt.NDArray[np.intp]:
    """Return the index of the band of the cosines of each wavelength, (rows, columns)."""
    return (_wavenumbers(shape) / _BAND).astype(np.intp)


def _wavenumbers(shape: tuple[int, ...]) -> Array:
    """Return the wavenumbers of the products of cosines, in radians per tile."""
    rows, columns = (np.pi * np.arange(number) / number for number in shape)
    return np.asarray(np.hypot(rows[:, None], columns))
