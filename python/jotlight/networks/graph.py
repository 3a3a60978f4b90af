"""How the layers of a network are connected, and what follows from it."""

import math
import operator
from collections.abc import Sequence
from fractions import Fraction

from jotlight.networks.layer import Layer

_LARGEST_STEP = 256
"""Rows of a picture that one row of planes stands for, at most."""


def sources(layers: Sequence[Layer]) -> list[int]:
    """Give the number of the layer that each reads; -1 for the first, which reads the data."""
    return [
        index - 1 if layer.input is None else operator.index(layer.input)
        for index, layer in enumerate(layers)
    ]


def scales(layers: Sequence[Layer]) -> list[Fraction]:
    """Give the pixels along a row of the picture for each that a layer's planes have.

    Raises
    ------
    ValueError
        When a layer reads or adds planes that do not fit.
    """
    found: list[Fraction] = []
    for index, (layer, source) in enumerate(zip(layers, sources(layers), strict=True)):
        if index == 0:
            if source != -1 or layer.skip is not None or layer.stride * layer.upsampling != 1:
                raise ValueError(
                    "layers: expected the first one to read the data, and to have no stride, "
                    "upsampling or kept planes"
                )
            found.append(Fraction(1))
            continue
        for what, number in (("input", source), ("skip", layer.skip)):
            if number is not None and not 0 <= number < index:
                raise ValueError(
                    f"layers: expected layer {index} to take planes of 0 to {index - 1}, got "
                    f"{what} {number}"
                )
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
                f"layers: expected layer {index} to add planes like its own, of {layer.channels} "
                f"channels, got those of layer {layer.skip}"
            )
    taken = {*sources(layers), *(layer.skip for layer in layers)}
    for index in range(len(layers) - 1):
        if index not in taken:
            raise ValueError(
                f"layers: expected the planes of layer {index} to be read or added, got no layer "
                "that does"
            )
    if layers[-1].channels != 1 or found[-1] != 1:
        raise ValueError(
            f"layers: expected one output channel of the last layer, in the picture's own size, "
            f"got {layers[-1].channels}"
        )
    return found


def size_divisor(layers: Sequence[Layer]) -> int:
    """Give what rows and columns of a picture have to be a multiple of.

    Raises
    ------
    ValueError
        When that is more than 256, or a pixel has more than 256 rows in some planes.
    """
    every = scales(layers)
    # What filters with a stride give has whole rows, before any are made of its depth.
    step = math.lcm(
        *((scale * layer.upsampling).numerator for layer, scale in zip(layers, every, strict=True))
    )
    largest = max(step, *(scale.denominator for scale in every))
    if largest > _LARGEST_STEP:
        raise ValueError(
            f"layers: expected strides and upsamplings of at most {_LARGEST_STEP} together, got "
            f"{largest}"
        )
    return step


def is_sequential(layers: Sequence[Layer]) -> bool:
    """Whether each layer filters and bends what the one before gave, and no more."""
    plain = all(
        layer.stride == layer.upsampling == 1
        and layer.skip is None
        and layer.coefficients is not None
        and not layer.set_counts
        for layer in layers
    )
    return plain and sources(layers) == list(range(-1, len(layers) - 1))


def flops_per_pixel(layers: Sequence[Layer]) -> float:
    """Give the operations per pixel of a picture: 2 for each tap, 10 for each value of a spline.

    Examples
    --------
    >>> tap, spline = np.ones((1, 1, 1, 1), np.float32), np.ones((1, 4), np.float32)
    >>> flops_per_pixel([Layer(tap, spline), Layer(np.ones((1, 1, 3, 3), np.float32), None)])  # 2 + 10 + 18
    30.0
    """
    work = Fraction(0)
    for layer, scale in zip(layers, scales(layers), strict=True):
        # From depth to space comes after the filters.
        work += 2 * math.prod(layer.shape) / (scale * layer.upsampling) ** 2
        if layer.coefficients is not None:
            work += 10 * layer.channels / scale**2
    return float(work)


def halo_radius(layers: Sequence[Layer]) -> int:
    """Give the pixels around a pixel that its estimate depends on, in whole steps."""
    step = size_divisor(layers)
    # Of each layer's planes, what the pixels of one step of the picture depend on.
    ranges: list[tuple[Fraction, Fraction] | None] = [None] * len(layers)
    ranges[-1] = Fraction(0), Fraction(step)
    for index, layer in reversed(list(enumerate(layers))):
        found = ranges[index]
        if index == 0 or found is None:
            continue
        first, last = (
            math.floor(found[0] / layer.upsampling),
            math.ceil(found[1] / layer.upsampling),
        )
        aligned = Fraction(first * layer.upsampling), Fraction(last * layer.upsampling)
        reads = []
        for size, before in zip(layer.shape[2:], layer.padding, strict=True):
            start = first * layer.stride - before
            reads.append((Fraction(start), Fraction((last - 1) * layer.stride - before + size)))
        source = sources(layers)[index]
        ranges[source] = _hull(ranges[source], *reads)
        if layer.skip is not None:
            ranges[layer.skip] = _hull(ranges[layer.skip], aligned)
    assert ranges[0] is not None, "every layer is used"
    around = max(-ranges[0][0], ranges[0][1] - step)
    return step * math.ceil(around / step)


def _hull(
    *ranges: tuple[Fraction, Fraction] | None,
) -> tuple[Fraction, Fraction]:
    known = [x for x in ranges if x is not None]
    return min(x[0] for x in known), max(x[1] for x in known)
