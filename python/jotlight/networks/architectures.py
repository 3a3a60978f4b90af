"""Deeper members of the network family: more layers and channels of the same two parts."""

import dataclasses
import math
import operator
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators import vst
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.networks.layer import Layer
from jotlight.networks.splines import Array, Function, fit_spline, identity_spline, relu_spline
from jotlight.sensing.sensor import Sensor


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
"""The deep architectures, by name."""

TWO_LAYER = "two-layer"
"""The name of the paper's two-layer network."""

SIZES = TWO_LAYER, *ARCHITECTURES
"""All sizes, from the fastest to the most accurate."""

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
        coefficients = (
            np.repeat(relu_spline(_LOW, _HIGH, _KNOTS), outputs, axis=0) if splines else None
        )
        knots = (_LOW, (_HIGH - _LOW) / (_KNOTS - 3)) if splines else (0.0, 1.0)
        self.layers.append(Layer(filters, coefficients, *knots, upsampling=upsampling, **options))
        return len(self.layers) - 1


def add_unet(build: Builder, architecture: Architecture, source: int) -> None:
    """Append the layers of a member, all but the last."""
    build.add(
        architecture.channels[0], 6, stride=2, input=source, gain=3.0, remove_mean=_MEAN_REMOVED
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
    add_unet(build, architecture, source=0)
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
    add_unet(build, architecture, source=2)
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


def build_two_layer(
    sensor: Sensor, sigma: float, tied: bool, taps: int, coefficients: int, nu: float
) -> list[Layer]:
    """Give the layers; :meth:`jotlight.Network.initial` says what these are."""
    if not (math.isfinite(sigma) and sigma > 0):
        raise ValueError(f"sigma: expected a number above 0, got {sigma}")
    taps, coefficients = operator.index(taps), operator.index(coefficients)
    if taps < 1 or taps % 2 == 0:
        raise ValueError(f"taps: expected an odd number, got {taps}")
    if coefficients < 5:
        raise ValueError(f"coefficients: expected at least 5, got {coefficients}")
    if not (math.isfinite(nu) and nu >= 0):
        raise ValueError(f"nu: expected a number of 0 or more, got {nu}")
    bits = sensor.bits_per_pixel

    from scipy.optimize import isotonic_regression

    low, high = vst.anscombe([0, bits], bits).astype(float)

    def intensity(z: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        counts = vst.inverse_anscombe(z.clip(low, high), bits, inverse="algebraic")
        return intensity_from_probability(counts / np.float32(bits), sensor, None).astype(
            np.float64
        )

    block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)
    first = fit_spline(
        lambda counts: vst.anscombe(counts, bits).astype(np.float64), 0.0, bits, coefficients
    )
    # A spline stays in the hull of its coefficients, so u lies there, and r not far from there.
    least, most = float(first[0].min()), float(first[0].max())
    room = nu * (most - least)
    second = fit_spline(intensity, least - room, most + room, coefficients)
    # At the ends of [0, S] the fit swings a little; more light never gives less.
    rising = isotonic_regression(second[0][0]).x[None].astype(np.float32)
    second = (rising.clip(0, sensor.max_intensity), *second[1:])
    return [
        Layer(np.ones((1, *block), np.float32), *first),
        Layer(gaussian_filter(sigma, taps), *second),
    ]
