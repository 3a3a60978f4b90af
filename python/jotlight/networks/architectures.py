"""Deeper members of the network family: more layers and channels of the same two parts."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.networks.layer import Layer

Array = npt.NDArray[np.float32]
Function = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]


@dataclasses.dataclass(frozen=True)
class Architecture:
    """The size of a architecture."""

    channels: tuple[int, ...]
    """Of the planes at half the picture's rows and columns, at a quarter, and so on."""
    layers: tuple[int, ...]
    """3 x 3 layers at each of them: as many on the way up as down, at the last in all."""


ARCHITECTURES = {
    "small": Architecture((12,), (3,)),
    "medium": Architecture((24, 52), (2, 3)),
    "large": Architecture((40, 80), (2, 5)),
}
"""Sizes by name; the two-layer network is smaller still."""

_SIGMA, _TAPS = 1.2, 7
_LOW, _HIGH, _KNOTS = -3.0, 3.0, 13
_INVERSE = 150
_MEAN_REMOVED = 0.8
_SETS, _WIDEST, _NARROWEST, _WIDE_TAPS = 6, 3.0, 0.8, 11


class Builder:
    """Puts layers together, with random filters, the last of which are 0."""

    def __init__(self, layers: list[Layer], rng: np.random.Generator) -> None:
        self.layers = layers
        self.rng = rng

    def add(
        self,
        outputs: int,
        taps: int,
        *,
        splines: bool = True,
        upsampling: int = 1,
        gain: float = 1.0,
        remove_mean: float = 0.0,
        **options: Any,
    ) -> int:
        """Append a layer; gives its number."""
        source = options.get("input", len(self.layers) - 1)
        inputs = self.layers[source].channels
        shape = (outputs * upsampling**2, inputs, taps, taps)
        size = gain * math.sqrt((2 if splines else 1) / (inputs * taps**2))
        filters = self.rng.normal(0, size, shape).astype(np.float32)
        # What is even is as large as anything else, and would drive the splines out of their range.
        filters -= remove_mean * filters.mean((2, 3), keepdims=True)
        coefficients = np.repeat(relu_spline(), outputs, axis=0) if splines else None
        knots = (_LOW, (_HIGH - _LOW) / (_KNOTS - 3)) if splines else (0.0, 1.0)
        self.layers.append(Layer(filters, coefficients, *knots, upsampling=upsampling, **options))
        return len(self.layers) - 1


def relu_spline() -> Array:
    """Coefficients (1, N_w) of a spline that is nearly max(z, 0)."""
    places = np.linspace(_LOW, _HIGH, _KNOTS - 2)
    spacing = places[1] - places[0]
    every = np.concatenate([[places[0] - spacing], places, [places[-1] + spacing]])
    coefficients: Array = np.maximum(every, 0)[None].astype(np.float32)
    return coefficients


def add_unet(build: Builder, architecture: Architecture, input: int) -> None:
    """Append the layers of a member, all but the last."""
    build.add(
        architecture.channels[0], 6, stride=2, input=input, gain=3.0, remove_mean=_MEAN_REMOVED
    )
    kept = []
    for depth, (channels, number) in enumerate(
        zip(architecture.channels, architecture.layers, strict=True)
    ):
        if depth:
            build.add(channels, 2, splines=False, stride=2)
        for _ in range(number - (depth == 0)):
            build.add(channels, 3)
        kept.append(len(build.layers) - 1)
    for depth in reversed(range(len(architecture.channels) - 1)):
        build.add(architecture.channels[depth], 1, splines=False, upsampling=2, skip=kept[depth])
        for _ in range(architecture.layers[depth]):
            build.add(architecture.channels[depth], 3)


def add_head(build: Builder, spline: tuple[Array, float, float], skip: int) -> list[Layer]:
    """Append the last layer, whose filters are 0, so that the output is φ of the planes it adds."""
    zeros = np.zeros((4, build.layers[-1].channels, 3, 3), np.float32)
    build.layers.append(Layer(zeros, *spline, upsampling=2, skip=skip, trainable="filters"))
    return build.layers


def gaussian_filter(sigma: float, taps: int) -> Array:
    """Filters (1, 1, taps, taps) that sum to 1."""
    line = np.exp(-0.5 * (np.arange(taps) - taps // 2) ** 2 / sigma**2)
    found = np.outer(line, line) / line.sum() ** 2
    # Far below the rounding of the sum; smaller still, processors would take ages over them.
    found[found < 1e-12] = 0
    filters: Array = found[None, None].astype(np.float32)
    return filters


def identity_spline(most: float) -> tuple[Array, float, float]:
    """Coefficients, start and spacing of a spline that is z between 0 and `most`."""
    return (most * np.array([[-1, 0, 1, 2]])).astype(np.float32), 0.0, most


def build_residual(
    architecture: Architecture, bits: int, inverse: Function, most: float, rng: np.random.Generator
) -> list[Layer]:
    """Give the layers of a member at its start, x0 = P⁻¹(G * L/K) in [0, `most`].

    `inverse` is P⁻¹, from shares of ones to intensities.
    """
    start = [
        Layer(
            np.full((1, 1, 1, 1), 1 / bits, np.float32), *identity_spline(1.0), trainable="nothing"
        ),
        Layer(
            gaussian_filter(_SIGMA, _TAPS),
            *fit_spline(inverse, 0.0, 1.0, _INVERSE),
            trainable="nothing",
        ),
    ]
    build = Builder(start, rng)
    add_unet(build, architecture, input=0)
    return add_head(build, identity_spline(most), skip=1)


def build_conditional(
    architecture: Architecture, bits: tuple[int, int], rng: np.random.Generator
) -> list[Layer]:
    """Give the layers of a member at its start that is told K, from shares of ones to shares.

    It works on z = arcsin √(L/K), whose noise is the same at any exposure, 1/(2 √K).
    """
    # Few bits need wider filters.
    sigmas = np.geomspace(_WIDEST, _NARROWEST, _SETS)
    one = np.ones((1, 1, 1, 1), np.float32)
    smooth = np.stack([gaussian_filter(float(sigma), _WIDE_TAPS) for sigma in sigmas])
    coefficients, low, spacing = fit_spline(
        lambda share: np.arcsin(np.sqrt(share.clip(0, 1))), 0.0, 1.0, _INVERSE
    )
    centred = coefficients - np.float32(np.pi / 4)
    build = Builder(
        [
            Layer(one, *identity_spline(1.0), trainable="nothing"),
            Layer(smooth, coefficients, low, spacing, trainable="nothing"),
            Layer(one, centred, low, spacing, input=0, trainable="nothing"),
        ],
        rng,
    )
    add_unet(build, architecture, input=2)
    layers = add_head(build, fit_spline(lambda z: np.sin(z) ** 2, 0.0, np.pi / 2, _INVERSE), skip=1)
    return [
        layer if layer.trainable == "nothing" else _with_parameter_sets(layer) for layer in layers
    ]


def _with_parameter_sets(layer: Layer) -> Layer:
    """The layer with as many equal sets of all that it learns."""
    filters, coefficients = layer.filters, layer.coefficients
    if coefficients is not None and layer.trainable == "all":
        coefficients = np.repeat(coefficients[None], _SETS, axis=0)
    filters = np.repeat(filters[None], _SETS, axis=0)
    return dataclasses.replace(layer, filters=filters, coefficients=coefficients)


def fit_spline(
    function: Function,
    low: float,
    high: float,
    number: int,
) -> tuple[Array, float, float]:
    """Coefficients (1, number), start and spacing of the least-squares spline on [low, high]."""
    from scipy.interpolate import make_lsq_spline

    spacing = (high - low) / (number - 3)
    knots = low + spacing * (np.arange(number + 4) - 3)
    # Eight samples to an interval, kept inside where rounding might put the last one out.
    samples = np.linspace(low, high, 8 * (number - 3) + 1).clip(knots[3], knots[-4])
    spline = make_lsq_spline(samples, function(samples), knots, k=3)
    return spline.c[None].astype(np.float32), float(low), float(spacing)
