"""What the iterative methods minimise, with dense matrices and other people's solvers."""

import dataclasses

import cvxpy as cp
import numpy as np
from scipy.optimize import minimize
from scipy.special import gammainc, gammaincc, gammaln, xlogy

from reference import sensing


def spread_matrix(shape, kernel, oversampling):
    """G, one column for each pixel."""
    whole = np.ones((1, 1))
    for size in shape:
        columns = [
            sensing.spread(pixel, sensing.DEGREES[kernel], oversampling) for pixel in np.eye(size)
        ]
        whole = np.kron(whole, np.transpose(columns))
    return whole


@dataclasses.dataclass
class Cost:
    """-ℓ(A c) in nats, as a function of the pixels c in a row."""

    matrix: np.ndarray
    ones: np.ndarray
    trials: np.ndarray
    threshold: int = 1
    dark: np.ndarray | float = 0.0
    most: float = 1.0

    def rate(self, image):
        return np.maximum(self.matrix @ np.ravel(image), 1e-12) + self.dark

    def __call__(self, image):
        rate, zeros = self.rate(image), self.trials - self.ones
        fired, stayed_dark = gammainc(self.threshold, rate), gammaincc(self.threshold, rate)
        return -np.sum(xlogy(self.ones, fired) + xlogy(zeros, stayed_dark))

    def cells(self, image):
        """The slope and the curvature of each cell."""
        rate, q, zeros = self.rate(image), self.threshold, self.trials - self.ones
        density = np.exp((q - 1) * np.log(rate) - rate - gammaln(q))
        up, down = density / gammainc(q, rate), density / gammaincc(q, rate)
        relative = (q - 1) / rate - 1
        curvature = self.ones * up * (up - relative) + zeros * down * (down + relative)
        return zeros * down - self.ones * up, curvature

    def gradient_and_curvature(self, image):
        """The gradient, and a bound of the curvature, pixel by pixel."""
        slope, curvature = self.cells(image)
        return self.matrix.T @ slope, self.matrix.T @ (curvature * self.matrix.sum(axis=1))

    def projected_gradient(self, image):
        """How far a step by the gradient over the curvature would go, as a share of S."""
        gradient, bound = self.gradient_and_curvature(image)
        image = np.ravel(image)
        step = gradient / np.maximum(bound, 1e-300)
        return np.abs(image - np.clip(image - step, 0, self.most)).max() / self.most

    def least(self):
        """The image that SciPy finds."""
        return minimize(
            lambda image: (self(image), self.gradient_and_curvature(image)[0]),
            np.full(self.matrix.shape[1], self.most / 2),
            jac=True,
            bounds=[(0, self.most)] * self.matrix.shape[1],
            method="L-BFGS-B",
            options={"maxiter": 20000, "maxfun": 40000, "ftol": 1e-13, "gtol": 1e-9},
        ).x


def cost_of(bits, sensor):
    """Of the bits of one channel, jot by jot."""
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


def by_pixel(cost, shape):
    """The cells of a box kernel whose jots are alike, put together."""
    cells = cost.matrix > 0
    return dataclasses.replace(
        cost,
        matrix=np.diag(cost.matrix.max(axis=0)),
        ones=cells.T @ cost.ones,
        trials=cells.T @ cost.trials,
        dark=np.divide(cells.T @ cost.dark, cells.sum(axis=0)),
    )


def variation(image, norm, weight=1.0):
    """TV, the differences past the rim 0."""
    image = np.asarray(image, float)
    steps = [np.diff(image, axis=axis, append=np.take(image, [-1], axis)) for axis in
             range(image.ndim)]  # fmt: skip
    lengths = np.hypot(*steps) if norm == "isotropic" and len(steps) == 2 else sum(map(abs, steps))
    return np.sum(weight * lengths)


def _lengths(image, norm):
    """TV's share of each pixel, for cvxpy; an image is (H, W)."""
    down = cp.vstack([cp.diff(image, axis=0), np.zeros((1, image.shape[1]))]) if (
        image.shape[0] > 1
    ) else np.zeros(image.shape)  # fmt: skip
    right = cp.hstack([cp.diff(image, axis=1), np.zeros((image.shape[0], 1))])
    steps = cp.vstack([cp.vec(down, order="C"), cp.vec(right, order="C")])
    return cp.norm(steps, 2 if norm == "isotropic" else 1, axis=0)


def least_variation(cost, shape, weight, norm):
    """The image with the least -ℓ + λ TV, for q = 1, and that least, by Clarabel."""
    image = cp.Variable(shape if len(shape) == 2 else (1, *shape))
    light = cost.matrix @ cp.vec(image, order="C") + cost.dark
    likelihood = cost.ones @ cp.log1p(-cp.exp(-light)) - (cost.trials - cost.ones) @ light
    weights = np.broadcast_to(weight, image.shape).ravel()
    problem = cp.Problem(
        cp.Minimize(weights @ _lengths(image, norm) - likelihood),
        [image >= 0, image <= cost.most],
    )
    problem.solve(solver=cp.CLARABEL)
    # By rounding it may lie a little outside.
    found = np.clip(image.value, 0, cost.most).reshape(shape)
    return found, cost(found) + variation(found, norm, weight)


def excess(cost, image, weight, norm):
    """At most so much above the least is -ℓ + λ TV: for any q, -ℓ lies above its tangent."""
    other = cp.Variable(np.shape(image))
    gradient = cost.gradient_and_curvature(image)[0]
    weights = np.broadcast_to(weight, np.shape(image)).ravel()
    tangent = gradient @ (cp.vec(other, order="C") - np.ravel(image))
    problem = cp.Problem(
        cp.Minimize(weights @ _lengths(other, norm) + tangent),
        [other >= 0, other <= cost.most],
    )
    return variation(image, norm, weight) - problem.solve(solver=cp.CLARABEL)


def polished(cost, image, weight, norm):
    """-ℓ + λ TV after some steps of the proximal Newton method from an image, for any q."""

    def objective(candidate):
        return cost(candidate) + variation(candidate, norm, weight)

    weights = np.broadcast_to(weight, np.shape(image)).ravel()
    for _ in range(4):
        slope, curvature = cost.cells(image)
        other = cp.Variable(np.shape(image))
        change = cost.matrix @ (cp.vec(other, order="C") - np.ravel(image))
        model = slope @ change + 0.5 * cp.sum_squares(
            cp.multiply(np.sqrt(np.maximum(curvature, 0)), change)
        )
        cp.Problem(
            cp.Minimize(weights @ _lengths(other, norm) + model), [other >= 0, other <= cost.most]
        ).solve(solver=cp.CLARABEL)
        target = np.clip(other.value, 0, cost.most)
        image = min((image + 0.5**k * (target - image) for k in range(8)), key=objective)
    return objective(image)
