"""Twins of what the iterative methods minimize, with dense matrices and other packages' solvers."""

import dataclasses

import cvxpy as cp
import numpy as np
from scipy.optimize import minimize
from scipy.special import gammainc, gammaincc, gammaln, xlogy

from reference import sensing


def scene(height, width):
    """Return an image of smooth waves in [0, 1] with an edge."""
    rows, columns = np.mgrid[:height, :width]
    waves = 0.45 + 0.35 * np.sin(columns / 3) * np.cos(rows / 4)
    return np.where(columns > 0.6 * width, 0.3, 1) * waves


def run(method, data, sensor=None, **options):
    """Return the estimate, its history, and a list with the estimate of each iteration."""
    estimates = []
    estimate, history = method(
        data,
        sensor,
        callback=lambda iteration: estimates.append(iteration.estimate.copy()),
        return_history=True,
        **options,
    )
    return estimate, history, estimates


def spread_matrix(shape, kernel, oversampling):
    """Return the matrix G, with one column for each pixel."""
    matrix = np.ones((1, 1))
    for size in shape:
        columns = [
            sensing.spread(pixel, sensing.DEGREES[kernel], oversampling) for pixel in np.eye(size)
        ]
        matrix = np.kron(matrix, np.transpose(columns))
    return matrix


@dataclasses.dataclass
class Cost:
    """-ℓ(A c) in nats as a function of the pixels c: equation (4)."""

    matrix: np.ndarray
    ones: np.ndarray
    trials: np.ndarray
    threshold: int = 1
    dark: np.ndarray | float = 0.0
    max_intensity: float = 1.0

    def rate(self, image):
        return np.maximum(self.matrix @ np.ravel(image), 1e-12) + self.dark

    def __call__(self, image):
        rate, zeros = self.rate(image), self.trials - self.ones
        one, zero = gammainc(self.threshold, rate), gammaincc(self.threshold, rate)
        return -np.sum(xlogy(self.ones, one) + xlogy(zeros, zero))

    def cell_derivatives(self, image):
        """Return the gradient and the curvature of each cell."""
        rate, q, zeros = self.rate(image), self.threshold, self.trials - self.ones
        density = np.exp((q - 1) * np.log(rate) - rate - gammaln(q))
        up, down = density / gammainc(q, rate), density / gammaincc(q, rate)
        relative = (q - 1) / rate - 1
        curvature = self.ones * up * (up - relative) + zeros * down * (down + relative)
        return zeros * down - self.ones * up, curvature

    def gradient_and_bound(self, image):
        """Return the gradient, and an upper bound of the curvature of each pixel."""
        gradient, curvature = self.cell_derivatives(image)
        return self.matrix.T @ gradient, self.matrix.T @ (curvature * self.matrix.sum(axis=1))

    def projected_gradient(self, image):
        """Return the largest move of a gradient step scaled by the bound, as a share of S."""
        gradient, bound = self.gradient_and_bound(image)
        image = np.ravel(image)
        step = gradient / np.maximum(bound, 1e-300)
        move = image - np.clip(image - step, 0, self.max_intensity)
        return np.abs(move).max() / self.max_intensity

    def minimize(self):
        """Return the minimizing image, found by SciPy's L-BFGS-B."""
        return minimize(
            lambda image: (self(image), self.gradient_and_bound(image)[0]),
            np.full(self.matrix.shape[1], self.max_intensity / 2),
            jac=True,
            bounds=[(0, self.max_intensity)] * self.matrix.shape[1],
            method="L-BFGS-B",
            options={"maxiter": 20000, "maxfun": 40000, "ftol": 1e-13, "gtol": 1e-9},
        ).x


def build_cost(bits, sensor):
    """Return the cost of the bits of one channel. The cells are the jots."""
    frames, *jots = bits.shape
    shape = [size // sensor.oversampling for size in jots]
    live = np.ones(jots, bool) if sensor.mask is None else ~sensor.mask
    ones = bits.to_array().sum(axis=0) * live
    matrix = spread_matrix(shape, sensor.kernel, sensor.oversampling)
    dark = np.broadcast_to(sensor.dark_counts, jots).ravel().astype(float)
    return Cost(
        sensor.efficiency * sensor.gain / frames * matrix,
        ones.ravel(),
        frames * live.ravel(),
        sensor.threshold,
        dark,
        sensor.max_intensity,
    )


def merge_cells(cost):
    """Return the cost of a box kernel with equal jots, with one cell for each pixel."""
    cells = cost.matrix > 0
    return dataclasses.replace(
        cost,
        matrix=np.diag(cost.matrix.max(axis=0)),
        ones=cells.T @ cost.ones,
        trials=cells.T @ cost.trials,
        dark=np.divide(cells.T @ cost.dark, cells.sum(axis=0)),
    )


def total_variation(image, norm, weight=1.0):
    """Return TV. The differences across the border are 0."""
    image = np.asarray(image, float)
    differences = [
        np.diff(image, axis=axis, append=np.take(image, [-1], axis)) for axis in range(image.ndim)
    ]
    if norm == "isotropic" and len(differences) == 2:
        lengths = np.hypot(*differences)
    else:
        lengths = sum(map(abs, differences))
    return np.sum(weight * lengths)


def minimize_with_variation(cost, shape, weight, norm):
    """Return the image that minimizes -ℓ + λ TV for q = 1, and the minimum, by Clarabel."""
    image = cp.Variable(shape if len(shape) == 2 else (1, *shape))
    light = cost.matrix @ cp.vec(image, order="C") + cost.dark
    likelihood = cost.ones @ cp.log1p(-cp.exp(-light)) - (cost.trials - cost.ones) @ light
    weights = np.broadcast_to(weight, image.shape).ravel()
    problem = cp.Problem(
        cp.Minimize(weights @ _lengths(image, norm) - likelihood),
        [image >= 0, image <= cost.max_intensity],
    )
    problem.solve(solver=cp.CLARABEL)
    # Rounding can put pixels slightly outside of the bounds.
    solution = np.clip(image.value, 0, cost.max_intensity).reshape(shape)
    return solution, cost(solution) + total_variation(solution, norm, weight)


def suboptimality_bound(cost, image, weight, norm):
    """Return an upper bound of -ℓ + λ TV above its minimum. Any q: -ℓ lies above its tangent."""
    other = cp.Variable(np.shape(image))
    gradient = cost.gradient_and_bound(image)[0]
    weights = np.broadcast_to(weight, np.shape(image)).ravel()
    tangent = gradient @ (cp.vec(other, order="C") - np.ravel(image))
    problem = cp.Problem(
        cp.Minimize(weights @ _lengths(other, norm) + tangent),
        [other >= 0, other <= cost.max_intensity],
    )
    return total_variation(image, norm, weight) - problem.solve(solver=cp.CLARABEL)


def refined_objective(cost, image, weight, norm):
    """Return -ℓ + λ TV after four proximal Newton steps from an image, for any q."""

    def objective(candidate):
        return cost(candidate) + total_variation(candidate, norm, weight)

    weights = np.broadcast_to(weight, np.shape(image)).ravel()
    for _ in range(4):
        gradient, curvature = cost.cell_derivatives(image)
        other = cp.Variable(np.shape(image))
        change = cost.matrix @ (cp.vec(other, order="C") - np.ravel(image))
        model = gradient @ change + 0.5 * cp.sum_squares(
            cp.multiply(np.sqrt(np.maximum(curvature, 0)), change)
        )
        cp.Problem(
            cp.Minimize(weights @ _lengths(other, norm) + model),
            [other >= 0, other <= cost.max_intensity],
        ).solve(solver=cp.CLARABEL)
        target = np.clip(other.value, 0, cost.max_intensity)
        image = min((image + 0.5**k * (target - image) for k in range(8)), key=objective)
    return objective(image)


def _lengths(image, norm):
    """Return each pixel's part of TV as an expression of cvxpy, for an image (H, W)."""
    height, width = image.shape
    if height > 1:
        down = cp.vstack([cp.diff(image, axis=0), np.zeros((1, width))])
    else:
        down = np.zeros((height, width))
    right = cp.hstack([cp.diff(image, axis=1), np.zeros((height, 1))])
    steps = cp.vstack([cp.vec(down, order="C"), cp.vec(right, order="C")])
    return cp.norm(steps, 2 if norm == "isotropic" else 1, axis=0)
