"""The filter banks of a network in PyTorch: their geometry, and their products with planes."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from jotlight.networks.graph import sources
from jotlight.networks.layer import Layer
from jotlight.torch.padding import mirror_pad


class LayerSpec(NamedTuple):
    """A layer without its parameters: its connections, filter geometry, and knots."""

    input: int
    """Index of the layer that this one filters; -1: the data."""
    skip: int | None
    """Index of the layer that is added before the spline."""
    stride: int
    upsampling: int
    row_padding: tuple[int, int]
    """Rows of mirrored padding above and below."""
    column_padding: tuple[int, int]
    """Columns of mirrored padding left and right."""
    start: float
    """First knot of the splines."""
    spacing: float
    """Distance between knots."""


def layer_specs(layers: Sequence[Layer]) -> list[LayerSpec]:
    """Return the specification of each layer.

    Examples
    --------
    >>> import numpy as np
    >>> tap = np.ones((1, 1, 1, 1), np.float32)
    >>> wide = jl.Layer(np.ones((1, 1, 3, 5), np.float32), None)
    >>> specs = layer_specs([jl.Layer(tap, None), wide])
    >>> specs[1].input, specs[1].row_padding, specs[1].column_padding
    (0, (1, 1), (2, 2))
    """
    specs = []
    for layer, source in zip(layers, sources(layers), strict=True):
        rows, columns = (
            (before, size - layer.stride - before)
            for before, size in zip(layer.padding, layer.shape[2:], strict=True)
        )
        connections = source, layer.skip, layer.stride, layer.upsampling
        specs.append(LayerSpec(*connections, rows, columns, layer.start, layer.spacing))
    return specs


def knots_of(specs: Sequence[LayerSpec]) -> Tensor:
    """Return the first knot and the distance between knots of each layer, (layers, 2).

    Examples
    --------
    >>> import numpy as np
    >>> tap = np.ones((1, 1, 1, 1), np.float32)
    >>> knots_of(layer_specs([jl.Layer(tap, None)])).shape
    torch.Size([1, 2])
    """
    return torch.tensor(
        [(spec.start, spec.spacing) for spec in specs], dtype=torch.float64, device="cpu"
    )


def convolve(planes: Tensor, filters: Tensor, spec: LayerSpec, dtype: torch.dtype) -> Tensor:
    """Return D(h * u), equation (9) with a stride and the depth-to-space step."""
    padded = mirror_pad(planes, spec.row_padding, spec.column_padding)
    # PyTorch correlates, so the filters are flipped.
    sums = correlate(padded, filters.flip(2, 3), spec.stride, dtype)
    return functional.pixel_shuffle(sums, spec.upsampling) if spec.upsampling > 1 else sums


def correlate(planes: Tensor, filters: Tensor, stride: int, dtype: torch.dtype) -> Tensor:
    """Return the correlation of planes with filters.

    For a single plane per image, PyTorch's convolution takes 15 to 100 times as long on a CPU as
    the equivalents below.
    """
    outputs, inputs, *taps = filters.shape
    if (outputs, inputs) == (1, 1) and len(planes):
        if taps == [1, 1] and stride == 1:
            return planes * filters
        # The images of the batch become the channels of one image.
        number = len(planes)
        filters = filters.expand(number, 1, *taps)
        sums = functional.conv2d(planes.transpose(0, 1), filters, stride=stride, groups=number)
        return sums.transpose(0, 1)
    if dtype == torch.float32 or inputs == 1:
        return functional.conv2d(planes, filters, stride=stride)
    # In this data type, convolutions of planes with interleaved channels are the fastest.
    layout = torch.channels_last
    planes, filters = (x.to(dtype, memory_format=layout) for x in (planes, filters))
    sums = functional.conv2d(planes, filters, stride=stride)
    return sums.to(torch.float32, memory_format=torch.contiguous_format)
