"""The graph of a network's layers: connections, resolutions, and work."""

import math
import operator
from collections.abc import Sequence
from fractions import Fraction

from jotlight.networks.layer import Layer

_MAX_SIZE_DIVISOR = 256
"""Largest size divisor, and largest number of feature-map rows per row of the estimate."""


def sources(layers: Sequence[Layer]) -> list[int]:
    """Return the index of each layer's input layer, and -1 for the first, which reads the data.

    Examples
    --------
    >>> import numpy as np
    >>> tap = np.ones((1, 1, 1, 1), np.float32)
    >>> sources([jl.Layer(tap, None), jl.Layer(tap, None), jl.Layer(tap, None, input=0)])
    [-1, 0, 0]
    """
    return [
        index - 1 if layer.input is None else operator.index(layer.input)
        for index, layer in enumerate(layers)
    ]


def scales(layers: Sequence[Layer]) -> list[Fraction]:
    """Return, for each layer, how many rows of the estimate one row of its output covers.

    Raises
    ------
    ValueError
        When the layers cannot be connected: an input or skip index is out of range, channels or
        resolutions differ, an output is unused, or the last layer is not at full resolution.
    """
    first = layers[0]
    if sources(layers)[0] != -1 or first.skip is not None or first.stride * first.upsampling != 1:
        raise ValueError(
            "layers: expected the first one to read the data, and to have no stride, "
            "upsampling or skip connection"
        )
    found = [Fraction(1)]
    for index, source in enumerate(sources(layers)[1:], 1):
        layer = layers[index]
        _check_indices(layer, index, source)
        if layer.shape[1] != layers[source].channels:
            raise ValueError(
                f"layers: expected {layers[source].channels} input channels in layer {index}, "
                f"got filters of shape {layer.shape}"
            )
        found.append(found[source] * layer.stride / layer.upsampling)
        if layer.skip is not None and (layers[layer.skip].channels, found[layer.skip]) != (
            layer.channels,
            found[-1],
        ):
            raise ValueError(
                f"layers: expected the skip connection of layer {index} to have its "
                f"{layer.channels} channels and its size, got the output of layer {layer.skip}"
            )
    _check_outputs(layers, found[-1])
    return found


def _check_indices(layer: Layer, index: int, source: int) -> None:
    for name, number in (("input", source), ("skip", layer.skip)):
        if number is not None and not 0 <= number < index:
            raise ValueError(
                f"layers: expected {name} of layer {index} to be 0 to {index - 1}, got {number}"
            )


def _check_outputs(layers: Sequence[Layer], last_scale: Fraction) -> None:
    used = {*sources(layers), *(layer.skip for layer in layers)}
    for index in range(len(layers) - 1):
        if index not in used:
            raise ValueError(
                f"layers: expected another layer to use the output of layer {index}, got none"
            )
    if last_scale != 1:
        raise ValueError(
            f"layers: expected outputs of the last layer in the size of the estimate, got a scale "
            f"of {last_scale}"
        )


def size_divisor(layers: Sequence[Layer]) -> int:
    """Return the number that must divide height and width; the engine pads other sizes.

    Raises
    ------
    ValueError
        When the divisor is above 256, or a feature map has more than 256 rows per row of the
        estimate.
    """
    all_scales = scales(layers)
    # Before its depth-to-space step, each layer has a whole number of rows.
    divisor = math.lcm(
        *(
            (scale * layer.upsampling).numerator
            for layer, scale in zip(layers, all_scales, strict=True)
        )
    )
    largest = max(divisor, *(scale.denominator for scale in all_scales))
    if largest > _MAX_SIZE_DIVISOR:
        raise ValueError(
            f"layers: expected strides and upsamplings of at most {_MAX_SIZE_DIVISOR} together, "
            f"got {largest}"
        )
    return divisor


def is_sequential(layers: Sequence[Layer]) -> bool:
    """Return whether each layer only filters the previous one's output and applies splines."""
    plain = all(
        layer.stride == layer.upsampling == 1
        and layer.skip is None
        and layer.coefficients is not None
        and not layer.set_counts
        for layer in layers
    )
    return plain and sources(layers) == list(range(-1, len(layers) - 1))


def flops_per_pixel(layers: Sequence[Layer]) -> float:
    """Return the operations per pixel of the estimate: 2 per tap, and 10 per spline value.

    Examples
    --------
    >>> import numpy as np
    >>> tap, coefficients = np.ones((1, 1, 1, 1), np.float32), np.ones((1, 4), np.float32)
    >>> last = jl.Layer(np.ones((1, 1, 3, 3)), None)
    >>> flops_per_pixel([jl.Layer(tap, coefficients), last])  # 2+10+18
    30.0
    """
    flops = Fraction(0)
    for layer, scale in zip(layers, scales(layers), strict=True):
        # The filters run before the depth-to-space step, on fewer pixels.
        flops += 2 * math.prod(layer.shape) / (scale * layer.upsampling) ** 2
        if layer.coefficients is not None:
            flops += 10 * layer.channels / scale**2
    return float(flops)
