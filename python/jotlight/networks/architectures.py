"""The layers of networks at their initial parameters: the paper's two layers, and deep U-Nets."""

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import positive_number, real_number, shown, whole_number
from jotlight.estimators import vst
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.networks.layer import Layer
from jotlight.networks.splines import Spline, fit_spline, identity_spline, relu_spline
from jotlight.parameter_names import check_choice
from jotlight.sensing.parameters.binomial import arcsin_root, squared_sine
from jotlight.sensing.sensor import Sensor, require_trainable


@dataclasses.dataclass(frozen=True)
class Architecture:
    """The numbers of channels and layers of a U-Net, from half resolution downward."""

    channels: tuple[int, ...]
    """Channels at 1/2, 1/4, ... of the resolution."""
    layers: tuple[int, ...]
    """Layers with splines at each resolution: this number on the way down, and again on the way up.
    The lowest resolution has them once."""


ARCHITECTURES = {
    "small": Architecture((12,), (3,)),
    "medium": Architecture((24, 52), (2, 3)),
    "large": Architecture((40, 80), (2, 5)),
}
"""The deep architectures, by name."""

TWO_LAYER = "two-layer"
"""Name of the paper's network."""

SIZES = TWO_LAYER, *ARCHITECTURES
"""All sizes of networks, from the fastest to the most accurate."""

EXTRA_LARGE = "extra-large"
"""Name of "large" with its output averaged over four rotations of the data."""

QUALITIES = *SIZES, EXTRA_LARGE
"""All pretrained qualities, from the fastest to the best."""

_START_SIGMA, _START_TAPS = 1.2, 7
"""Gaussian that smooths the counts of a residual network: standard deviation, taps per side."""

_RELU = -3.0, 3.0, 13
"""Domain (two numbers) and number of coefficients of the splines in a U-Net."""

_FIT_COEFFICIENTS = 150
"""Number of coefficients of the splines that represent a known function."""

_REMOVED_MEAN = 0.8
"""Fraction of its mean that is subtracted from each filter of a U-Net's first layer."""

_SETS = 6
"""M, the number of parameter sets of a K-conditioned network."""

_WIDEST_SIGMA, _NARROWEST_SIGMA, _CONDITIONAL_TAPS = 3.0, 0.8, 11
"""Gaussians that smooth the counts of a K-conditioned network.

Standard deviations for the smallest and the largest K, and taps per side.
"""


def find_architecture(name: str) -> Architecture:
    """Return a deep architecture by name.

    Raises
    ------
    ValueError
        For an unknown name.
    """
    check_choice("architecture", name, ARCHITECTURES)
    return ARCHITECTURES[name]


def build_two_layer(
    sensor: Sensor, sigma: float, tied: bool, taps: int, coefficients: int, nu: float
) -> list[Layer]:
    """Return the paper's two layers; :meth:`jotlight.Network.initial` documents the parameters.

    The spline coefficients are least-squares fits. Those of φ2 are made monotone and clipped to
    [0, S], so every output lies in [0, S].
    """
    require_trainable(sensor)
    sigma = positive_number("sigma", sigma)
    taps = whole_number("taps", taps, 1)
    if taps % 2 == 0:
        raise ValueError(f"taps: expected an odd number, got {taps}")
    coefficients = whole_number("coefficients", coefficients, 5)
    if not 0 <= real_number(nu) < math.inf:
        raise ValueError(f"nu: expected a number of 0 or more, got {shown(nu)}")
    trials = sensor.trials
    low, high = vst.anscombe([0, trials], trials).astype(float)

    def stabilized(counts: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return vst.anscombe(counts, trials).astype(np.float64)

    def intensity(z: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        counts = vst.inverse_anscombe(z.clip(low, high), trials, inverse="algebraic")
        probability = counts / np.float32(trials)
        return intensity_from_probability(probability, sensor, None).astype(np.float64)

    first = fit_spline(stabilized, 0.0, trials, coefficients)
    # A spline, and so u, stays between its extreme coefficients; r exceeds them by up to `margin`.
    smallest, largest = float(first[0].min()), float(first[0].max())
    margin = nu * (largest - smallest)
    second = fit_spline(intensity, smallest - margin, largest + margin, coefficients)
    block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)
    return [
        Layer(np.ones((1, *block), np.float32), *first),
        Layer(gaussian_filter(sigma, taps), _monotone(second[0], sensor), *second[1:]),
    ]


def _monotone(coefficients: npt.NDArray[np.float32], sensor: Sensor) -> npt.NDArray[np.float32]:
    """Return the nearest coefficients that never decrease, clipped to [0, S].

    The fit oscillates near 0 and S, but a brighter pixel must not have a lower estimate.
    """
    from scipy.optimize import isotonic_regression

    monotone = isotonic_regression(coefficients[0]).x[None].astype(np.float32)
    return np.asarray(monotone.clip(0, sensor.max_intensity))


def build_residual(
    architecture: Architecture, sensor: Sensor, rng: np.random.Generator
) -> list[Layer]:
    """Return the layers of an untrained residual network.

    Its output is x0 = P⁻¹ of the smoothed L/K, in [0, S].

    Parameters
    ----------
    architecture : Architecture
        Channels and layers of the U-Net whose output is added to x0. Before training it is 0.
    sensor : Sensor
        The median replaces each map.
    rng : numpy.random.Generator
        Draws the filters.
    """
    require_trainable(sensor)

    def intensity(probability: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        clipped = probability.clip(0, 1).astype(np.float32)
        return intensity_from_probability(clipped, sensor, None).astype(np.float64)

    mean = np.full((1, 1, 1, 1), 1 / sensor.trials, np.float32)
    inverse = fit_spline(intensity, 0.0, 1.0, _FIT_COEFFICIENTS)
    smooth = gaussian_filter(_START_SIGMA, _START_TAPS)
    start = [
        Layer(mean, *identity_spline(1.0), trainable="nothing"),
        Layer(smooth, *inverse, trainable="nothing"),
    ]
    builder = Builder(start, rng)
    add_unet(builder, architecture, source=0)
    return add_head(builder, identity_spline(float(sensor.max_intensity)))


def build_conditional(name: str, rng: np.random.Generator) -> list[Layer]:
    """Return the layers of an untrained K-conditioned network.

    The network maps detected fractions L/K to detection probabilities. It works on z = arcsin
    √(L/K), whose noise has the standard deviation 1/(2 √K) at every exposure. Before training, it
    smooths z.

    Parameters
    ----------
    name : str
        Size of the network: one of `SIZES`. The paper's two layers smooth z; the U-Net of a deep
        network is added to the smoothed z.
    rng : numpy.random.Generator
        Draws the filters.

    Raises
    ------
    ValueError
        For an unknown name.
    """
    check_choice("architecture", name, SIZES)
    # Fewer bits need wider filters.
    sigmas = np.geomspace(_WIDEST_SIGMA, _NARROWEST_SIGMA, _SETS)
    smooth = np.stack([gaussian_filter(float(sigma), _CONDITIONAL_TAPS) for sigma in sigmas])
    one = np.ones((1, 1, 1, 1), np.float32)
    coefficients, low, spacing = fit_spline(arcsin_root, 0.0, 1.0, _FIT_COEFFICIENTS)
    probability = fit_probability()
    if name == TWO_LAYER:
        last = Layer(smooth, *probability, trainable="filters")
        return [with_sets(Layer(one, coefficients, low, spacing)), last]
    centered = coefficients - np.float32(np.pi / 4)
    start = [
        Layer(one, *identity_spline(1.0), trainable="nothing"),
        Layer(smooth, coefficients, low, spacing, trainable="nothing"),
        Layer(one, centered, low, spacing, input=0, trainable="nothing"),
    ]
    builder = Builder(start, rng)
    add_unet(builder, find_architecture(name), source=2)
    return [with_sets(layer) for layer in add_head(builder, probability)]


def fit_probability() -> Spline:
    """Return the spline of the last layer of K-conditioned networks: p = sin² z."""
    return fit_spline(squared_sine, 0.0, np.pi / 2, _FIT_COEFFICIENTS)


class Builder:
    """A growing list of layers with random filters and ReLU splines."""

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
        removed_mean: float = 0.0,
        **options: Any,
    ) -> None:
        """Append a layer of `outputs` channels with `taps` × `taps` filters.

        `gain` scales the random taps. Each filter loses the fraction `removed_mean` of its mean.
        `options` go to :class:`Layer`.
        """
        source = options.get("input", len(self.layers) - 1)
        inputs = self.layers[source].channels
        shape = (outputs * upsampling**2, inputs, taps, taps)
        deviation = gain * math.sqrt((2 if splines else 1) / (inputs * taps**2))
        filters = self.rng.normal(0, deviation, shape).astype(np.float32)
        # Otherwise, flat regions would drive the splines out of their domain.
        filters -= removed_mean * filters.mean((2, 3), keepdims=True)
        coefficients, start, spacing = None, 0.0, 1.0
        if splines:
            relu, start, spacing = relu_spline(*_RELU)
            coefficients = np.repeat(relu, outputs, axis=0)
        self.layers.append(
            Layer(filters, coefficients, start, spacing, upsampling=upsampling, **options)
        )


def add_unet(builder: Builder, architecture: Architecture, source: int) -> None:
    """Append a U-Net that reads layer `source`, except its last layer (:func:`add_head`)."""
    builder.add(
        architecture.channels[0], 6, stride=2, input=source, gain=3.0, removed_mean=_REMOVED_MEAN
    )
    skips = []
    for depth, (channels, number) in enumerate(
        zip(architecture.channels, architecture.layers, strict=True)
    ):
        if depth:
            builder.add(channels, 2, splines=False, stride=2)
        for _ in range(number - (depth == 0)):
            builder.add(channels, 3)
        skips.append(len(builder.layers) - 1)
    for depth in reversed(range(len(architecture.channels) - 1)):
        builder.add(architecture.channels[depth], 1, splines=False, upsampling=2, skip=skips[depth])
        for _ in range(architecture.layers[depth]):
            builder.add(architecture.channels[depth], 3)


def add_head(builder: Builder, spline: Spline) -> list[Layer]:
    """Return all layers after appending the last one.

    Its filters are 0, so before training its output is φ of layer 1, which the network corrects.
    """
    outputs = len(spline[0])
    zeros = np.zeros((4 * outputs, builder.layers[-1].channels, 3, 3), np.float32)
    builder.layers.append(Layer(zeros, *spline, upsampling=2, skip=1, trainable="filters"))
    return builder.layers


def with_sets(layer: Layer) -> Layer:
    """Return the layer with M equal sets of its trainable parameters."""
    if layer.trainable == "nothing":
        return layer
    filters, coefficients = layer.filters, layer.coefficients
    if coefficients is not None and layer.trainable == "all":
        coefficients = np.repeat(coefficients[None], _SETS, axis=0)
    filters = np.repeat(filters[None], _SETS, axis=0)
    return dataclasses.replace(layer, filters=filters, coefficients=coefficients)


def gaussian_filter(sigma: float, taps: int) -> npt.NDArray[np.float32]:
    """Return a Gaussian, shape (1, 1, taps, taps), with sum 1.

    Examples
    --------
    >>> round(float(gaussian_filter(0.7, 5).sum()), 6)
    1.0
    """
    profile = np.exp(-0.5 * (np.arange(taps) - taps // 2) ** 2 / sigma**2)
    gaussian = np.outer(profile, profile) / profile.sum() ** 2
    # Such taps are far below the rounding error of the sum, and subnormal ones would be slow.
    gaussian[gaussian < 1e-12] = 0
    return np.asarray(gaussian[None, None].astype(np.float32))
