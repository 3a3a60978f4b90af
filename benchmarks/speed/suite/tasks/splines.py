"""The evaluation of a cubic B-spline at every pixel."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import jotlight as jl
import jotlight._engine as engine
from suite.case import Case, Rival, relative_difference
from suite.tasks.scene import SENSOR

OPERATIONS = 8
"""Operations per evaluation: the position in the table (4), a cubic (3), and the look-up."""

NUMPY, SCIPY, TORCH = "NumPy", "SciPy, BSpline", "PyTorch"


def cases(quick: bool) -> Iterator[Case]:
    side = 512 if quick else 2048
    first = jl.pretrained(SENSOR, "two-layer").layers[0]
    layer = dataclasses.replace(first, filters=np.ones((1, 1, 1, 1), np.float32))
    z = np.random.default_rng(0).uniform(0, 16, (side, side)).astype(np.float32)

    yield Case(
        name="splines",
        title="Splines",
        description=f"The first layer's φ, {layer.coefficients.shape[1]} coefficients, for {side} "
        "× "
        f"{side} numbers.",
        items=side**2,
        unit="numbers",
        run=lambda threads: activated(layer, z, threads),
        rivals=[
            Rival(NUMPY, lambda _: lambda: numpy_spline(layer, z)),
            Rival(SCIPY, lambda package: scipy_spline(package, layer, z), "scipy.interpolate"),
            Rival(TORCH, lambda torch: torch_spline(torch, layer, z), "torch"),
        ],
        difference=relative_difference,
        agreement="largest difference relative to the largest value",
        tolerance=1e-5,
        operations=OPERATIONS * side**2,
        bytes=8 * side**2,
        operations_note="a number is read and one written; finding the position in the table "
        "takes four "
        "operations, and a look-up and a cubic of three multiply-adds follow",
    )


def activated(layer: jl.Layer, z: np.ndarray, threads: int) -> np.ndarray:
    out = np.empty_like(z)
    engine.forward([layer.engine_layer], [z[None]], [out], threads)
    return out


def numpy_spline(layer: jl.Layer, z: np.ndarray) -> np.ndarray:
    w = layer.coefficients[0]
    position = ((z - np.float32(layer.start)) / np.float32(layer.spacing)).clip(0, len(w) - 3)
    first = np.minimum(position.astype(np.int32), len(w) - 4)
    f = position - first
    g = 1 - f
    return (
        w[first] * g**3 / 6
        + w[first + 1] * (2 / 3 + 0.5 * f * f * (f - 2))
        + w[first + 2] * (2 / 3 + 0.5 * g * g * (g - 2))
        + w[first + 3] * f**3 / 6
    )


def scipy_spline(package: Any, layer: jl.Layer, z: np.ndarray) -> Callable[[], np.ndarray]:
    number = layer.coefficients.shape[1]
    knots = layer.start + layer.spacing * (np.arange(number + 4) - 3)
    spline = package.BSpline(knots, layer.coefficients[0].astype(np.float64), 3)
    return lambda: spline(z.clip(knots[3], knots[-4]))


def torch_spline(torch: Any, layer: jl.Layer, z: np.ndarray) -> Callable[[], np.ndarray]:
    from suite.torch_network import spline_by_interval

    coefficients = torch.from_numpy(layer.coefficients[0])
    return lambda: spline_by_interval(
        torch.from_numpy(z), coefficients, layer.start, layer.spacing
    ).numpy()
