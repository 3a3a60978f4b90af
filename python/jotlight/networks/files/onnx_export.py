"""Networks as ONNX models, which other runtimes execute (extra `onnx`).

A model is a network for one sensor. It maps `counts`, float32 (N, 1, H, W), to `intensity`, float32
(N, 1, H, W), for any N, H, and W. An untied network maps `bits` (N, T, H·K̂, W·K̂) instead. The model
consists of the standard operators of ONNX alone, so it runs wherever they run.

The model covers

- mirrored borders, and sizes that are not multiples of the network's size divisor;
- the parameters of a K-conditioned network for the K of the sensor, which are fixed in the model;
- K above the range of the network: the further runs of
  :mod:`jotlight.networks.inference.trials_map`, where the network occurs once more for each factor
  of 16;
- P⁻¹, dark counts, and efficiency, and the clipping to [0, S].

Its metadata are the sensor, as `jotlight sensor`, and the history of the network, as
`jotlight history`; its producer is the version of jotlight.

It does not cover dead jots, maps of efficiency or dark counts, and maps of trials: the sensor must
be the same for all pixels. Use the engine for these.
"""

import json
import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight._engine import RATIO_OF_PASS
from jotlight.errors import needs_module
from jotlight.estimators.inverse_response import equivalent_counts
from jotlight.files import write_file
from jotlight.networks.graph import size_divisor, sources
from jotlight.networks.inference.engine_backed import GrayNetwork
from jotlight.networks.inference.served_sensors import choose_sensor
from jotlight.networks.layer import Layer
from jotlight.networks.layer_checks import refuse_rotations
from jotlight.networks.splines import CUBIC_BASIS
from jotlight.paths import as_path
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.likelihood.reference import Jot, reference_jot
from jotlight.sensing.parameters.response import (
    detection_probability,
    inverse_detection_probability,
)
from jotlight.sensing.sensor import Sensor

if TYPE_CHECKING:
    from jotlight.networks.files.onnx_graph import GraphBuilder

Cubics = tuple[npt.NDArray[np.floating], float, float]
"""Cubics (C, I, 4), start, and spacing of :meth:`GraphBuilder.piecewise_cubics`."""

_INVERSE_INTERVALS = 1 << 14
"""Number of intervals of the cubics that represent P⁻¹ for thresholds above 1."""

_MAX_EXPONENT = 17.5
"""Above -log(1 - p) of the largest p below 1 in float32, which is 16.6."""


def write_onnx(path: str | os.PathLike[str], network: GrayNetwork, sensor: Sensor | None) -> None:
    """Write the ONNX model of a network for a sensor. The module describes the model.

    Parameters
    ----------
    path : path
        The file, such as ``"network.onnx"``.
    network : jotlight.Network
        The network.
    sensor : Sensor, optional
        The sensor of the data, without maps of its jots. Default: the network's.

    Raises
    ------
    MissingExtraError
        When the package onnx is not installed.
    ValueError
        When the network does not serve the sensor or averages over rotations, when the sensor has
        maps, or when there is no sensor for a K-conditioned network.

    Examples
    --------
    >>> import tempfile
    >>> sensor = jl.Sensor(frames=16)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_onnx(f"{folder}/medium.onnx", jl.pretrained(sensor), sensor)
    """
    refuse_rotations(network.rotations, "ONNX models")
    own, trials_range = network.sensor, network.trials_range
    sensor = choose_sensor(sensor, own, trials_range, tied=network.tied)
    with needs_module("onnx", "ONNX models need onnx: pip install 'jotlight[onnx]'"):
        from jotlight.networks.files.onnx_graph import GraphBuilder

    graph, data = GraphBuilder(), "counts" if network.tied else "bits"
    if trials_range is not None:
        intensity = _add_conditional(graph, data, network, sensor)
    else:
        side = 1 if network.tied else own.oversampling
        sums = _add_equivalent_counts(graph, data, network, sensor)
        intensity = _add_layers(graph, sums, network.layers, side)
    graph.add("Clip", intensity, 0.0, float(sensor.max_intensity))
    shape: tuple[int | str, ...] = (
        ("batch", 1, "height", "width")
        if network.tied
        else ("batch", sensor.frames, "jot_rows", "jot_columns")
    )
    model = graph.model(
        (data, shape),
        ("intensity", ("batch", 1, "height", "width")),
        f"jotlight network for {sensor!r}: {data} to intensities in [0, S]",
        {
            "jotlight sensor": json.dumps(sensor.scalars()),
            "jotlight history": json.dumps(network.history),
        },
    )
    path = as_path(path, 'network.export_onnx("mine.onnx")')
    write_file(path, model.SerializeToString(deterministic=True))


def _add_conditional(
    graph: "GraphBuilder", counts: str, network: GrayNetwork, sensor: Sensor
) -> str:
    """Return the intensities of a K-conditioned network, as `denoise_fractions` does."""
    assert network.trials_range is not None, "a K-conditioned network"
    trials = sensor.trials
    served = min(trials, network.trials_range[1])
    # For bright sensors, all that follows is about zeros instead of ones.
    is_zeros = network.estimates_zeros(sensor)
    layers = network.conditioned_layers(served, zeros=is_zeros)
    if is_zeros:
        counts = graph.add("Sub", float(trials), counts)

    def denoise(readings: str) -> str:
        ones = graph.add("Sub", float(served), readings) if is_zeros else readings
        return graph.add("Clip", _add_layers(graph, ones, layers, 1), 0.0, 1.0)

    def angle(probability: str) -> str:
        return graph.add("Asin", graph.add("Sqrt", probability))

    def squared_sine(angle: str) -> str:
        sine = graph.add("Sin", graph.add("Clip", angle, 0.0, math.pi / 2))
        return graph.add("Mul", sine, sine)

    estimate = denoise(graph.add("Mul", counts, served / trials))
    if trials > served:
        data = angle(graph.add("Div", graph.add("Add", counts, 0.375), trials + 0.75))
        gain = math.sqrt(trials / served)
        for _ in range(math.ceil(math.log(trials / served, RATIO_OF_PASS))):
            base = angle(estimate)
            difference = graph.add("Mul", graph.add("Sub", data, base), gain)
            raised = squared_sine(graph.add("Add", base, difference))
            readings = graph.add("Sub", graph.add("Mul", raised, served + 0.75), 0.375)
            change = graph.add("Sub", angle(denoise(readings)), base)
            estimate = squared_sine(graph.add("Add", base, graph.add("Div", change, gain)))
    if is_zeros:
        return _add_intensity(graph, graph.add("Neg", graph.add("Log", estimate)), sensor)
    return _add_inverse(graph, estimate, sensor)


def _add_intensity(graph: "GraphBuilder", rate: str, sensor: Sensor) -> str:
    """Return c = (K/α)(rate - d)/η, not clipped."""
    efficiency, dark_counts = reference_jot(sensor)
    light = efficiency * sensor.light_per_intensity
    return graph.add("Div", graph.add("Sub", rate, dark_counts), light)


def _add_inverse(graph: "GraphBuilder", probability: str, sensor: Sensor) -> str:
    """Return c = (K/α)(P⁻¹(q, p) - d)/η, not clipped."""
    efficiency, dark_counts = reference_jot(sensor)
    rate = _add_exponent(graph, probability)
    if sensor.threshold > 1:
        root = graph.add("Pow", rate, 1 / sensor.threshold)
        max_rate = efficiency * sensor.light_per_intensity * sensor.max_intensity + dark_counts
        rate = graph.piecewise_cubics("inverse", root, *_inverse_cubics(sensor.threshold, max_rate))
    return _add_intensity(graph, rate, sensor)


def _add_exponent(graph: "GraphBuilder", probability: str) -> str:
    """Return P⁻¹(1, p) = -log(1 - p), precise for small p and for p near 1."""
    # Above 1/2, 1 - p has no rounding error. Below, -log(1 - p) = 2 artanh(p/(2 - p)).
    large = graph.add("Neg", graph.add("Log", graph.add("Sub", 1.0, probability)))
    ratio = graph.add("Div", probability, graph.add("Sub", 2.0, probability))
    small = graph.add("Mul", graph.add("Atanh", ratio), 2.0)
    return graph.add("Where", graph.add("Greater", probability, 0.5), large, small)


def _inverse_cubics(threshold: int, max_rate: float) -> Cubics:
    """Return P⁻¹(q, p) up to a largest rate, in the variable v = (-log(1 - p))^(1/q).

    The rate is smooth in v, because p is near s^q/q! for small s, and log(1 - p) is near -s for
    large s.
    """
    from scipy.interpolate import CubicSpline

    with np.errstate(divide="ignore"):
        end = float(-np.log1p(-detection_probability(threshold, max_rate)))
    last = min(end, _MAX_EXPONENT) ** (1 / threshold)
    exponents = np.linspace(0, last, _INVERSE_INTERVALS + 1) ** threshold
    p, complement = -np.expm1(-exponents), np.exp(-exponents)
    rates = inverse_detection_probability(threshold, p, complement)
    # No p but 1 lies between the last knots, if `end` exceeds the largest exponent.
    rates[-1] = max_rate
    cubics = CubicSpline(np.arange(len(rates)), rates).c[::-1].T
    return cubics[None], 0.0, last / _INVERSE_INTERVALS


def _add_equivalent_counts(
    graph: "GraphBuilder", data: str, network: GrayNetwork, sensor: Sensor
) -> str:
    """Return the counts that the network's own sensor would report: a table of the counts."""
    reference = Jot(reference_jot(sensor).efficiency, reference_jot(network.sensor).dark_counts)
    if reference_jot(sensor) == reference:
        return data
    trials = sensor.trials
    counts = np.arange(trials + 1, dtype=np.int32)[None]
    pixels = count_pixels(counts, sensor, None)
    table = equivalent_counts(pixels, reference, trials, None)[0]
    cubics = np.zeros((1, trials, 4))
    cubics[0, :, 0], cubics[0, :, 1] = table[:-1], np.diff(table)
    return graph.piecewise_cubics("equivalent", data, cubics, 0.0, 1.0)


def _add_layers(graph: "GraphBuilder", data: str, layers: Sequence[Layer], side: int) -> str:
    """Return the output of the last layer, for counts or for bits of side × side jots per pixel."""
    filters = graph.constant("layers.0.filters", layers[0].filters)
    sums = graph.add("Conv", data, filters, strides=[side, side])
    planes = graph.pad_to_multiple(sums, size_divisor(layers))
    outputs: list[str] = []
    for index, (layer, source) in enumerate(zip(layers, sources(layers), strict=True)):
        if index:
            planes = _add_filters(graph, outputs[source], layer, f"layers.{index}.filters")
        if layer.skip is not None:
            planes = graph.add("Add", planes, outputs[layer.skip])
        if layer.coefficients is not None:
            name, cubics = f"layers.{index}", _interval_cubics(layer.coefficients)
            planes = graph.piecewise_cubics(name, planes, cubics, layer.start, layer.spacing)
        outputs.append(planes)
    return graph.crop(planes, data, side)


def _add_filters(graph: "GraphBuilder", planes: str, layer: Layer, name: str) -> str:
    """Return D(h * u), equation (9) with a stride and the depth-to-space step."""
    margins = [
        (before, size - layer.stride - before)
        for before, size in zip(layer.padding, layer.shape[2:], strict=True)
    ]
    planes = graph.mirror_pad(planes, margins)
    # ONNX correlates, so the filters are flipped.
    filters = graph.constant(name, layer.filters[:, :, ::-1, ::-1])
    planes = graph.add("Conv", planes, filters, strides=[layer.stride, layer.stride])
    if layer.upsampling > 1:
        planes = graph.add("DepthToSpace", planes, blocksize=layer.upsampling, mode="CRD")
    return planes


def _interval_cubics(coefficients: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """Return the cubics (C, I, 4) of splines with the coefficients (C, I + 3)."""
    windows = np.lib.stride_tricks.sliding_window_view(coefficients.astype(np.float64), 4, axis=1)
    return np.asarray(windows @ (np.array(CUBIC_BASIS) / 6))
