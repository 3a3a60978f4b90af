"""The network as a module of PyTorch, built from and written back to the same file."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn
from torch.nn import functional

import jotlight
from jotlight.networks.conditioning import conditioning_weights, count_sets
from jotlight.networks.graph import size_divisor, sources
from jotlight.networks.layer import Layer
from jotlight.torch.spline import spline


class Place(NamedTuple):
    """Where a layer stands in a network, and how it filters: all but what it learns."""

    input: int
    skip: int | None
    stride: int
    upsampling: int
    rows: tuple[int, int]
    """By how many the planes that it reads are continued, above and below."""
    columns: tuple[int, int]
    start: float
    spacing: float


def places_of(layers: Sequence[Layer]) -> list[Place]:
    """Give the place of each layer."""
    found = []
    for layer, source in zip(layers, sources(layers), strict=True):
        rows, columns = (
            (before, size - layer.stride - before)
            for before, size in zip(layer.padding, layer.shape[2:], strict=True)
        )
        found.append(
            Place(
                source,
                layer.skip,
                layer.stride,
                layer.upsampling,
                rows,
                columns,
                layer.start,
                layer.spacing,
            )
        )
    return found


class Network(nn.Module):
    """A jotlight network whose parameters PyTorch can learn.

    Parameters
    ----------
    network : jotlight.Network
        Where it starts.

    Examples
    --------
    >>> sensor = jotlight.Sensor(oversampling=4)
    >>> module = Network(jotlight.Network.initial(sensor))
    >>> module(torch.full((1, 1, 20, 30), 8.0)).shape
    torch.Size([1, 1, 20, 30])
    """

    def __init__(self, network: jotlight.Network) -> None:
        super().__init__()
        self.origin = network
        layers = network.layers
        # Arrays of NumPy would be tensors to torch.compile, which fails in its inference mode.
        self.places = places_of(layers)
        self._step, self._sets = size_divisor(layers), count_sets(layers)
        self._between, self._side = (
            network.trials_range,
            1 if network.tied else network.sensor.oversampling,
        )
        self.filters = nn.ParameterList(
            _parameter(layer.filters, layer.trainable != "nothing") for layer in layers
        )
        self.coefficients = nn.ParameterDict(
            {
                str(index): _parameter(layer.coefficients, layer.trainable == "all")
                for index, layer in enumerate(layers)
                if layer.coefficients is not None
            }
        )

    def forward(self, data: Tensor, bits: int | None = None) -> Tensor:
        """Give pictures (N, 1, H, W).

        Parameters
        ----------
        data : Tensor
            Counts L (N, 1, H, W) of a tied network, or bits (N, T, H·K̂, W·K̂) of one that weighs
            jots singly.
        bits : int, optional
            K, which a network for many K has to be told; it gives shares of ones then, P(b = 1).
        """
        return self.bent(-1, self.sums(data, bits), self._parameters_at(bits)[1][-1])

    def sums(self, data: Tensor, bits: int | None = None) -> Tensor:
        """Give what the last spline makes the pictures of, (N, 1, H, W)."""
        filters, coefficients = self._parameters_at(bits)
        sums = functional.conv2d(data.to(filters[0].dtype), filters[0], stride=self._side)
        height, width = sums.shape[-2:]
        sums = continued(sums, (0, -height % self._step), (0, -width % self._step))
        planes: list[Tensor] = []
        for index, place in enumerate(self.places):
            if index:
                planes.append(self.bent(index - 1, sums, coefficients[index - 1]))
                sums = _filtered(planes[place.input], filters[index], place)
            if place.skip is not None:
                sums = sums + planes[place.skip]
        return sums[..., :height, :width]

    def bent(self, index: int, sums: Tensor, coefficients: Tensor | None) -> Tensor:
        """Give φ of the sums of a layer: what a network with other nonlinearities replaces."""
        if coefficients is None:
            return sums
        return spline(sums, coefficients, self.places[index].start, self.places[index].spacing)

    def _parameters_at(self, bits: int | None) -> tuple[list[Tensor], list[Tensor | None]]:
        """Filters and coefficients of the layers, where the network is told K."""
        if (self._between is None) != (bits is None):
            raise ValueError(
                "bits: expected K for a network that is told it, and only for such a network, got "
                f"{bits}"
            )
        filters: list[Tensor] = list(self.filters)
        coefficients = [self.coefficients.get(str(index), None) for index in range(len(filters))]
        if self._between is None or bits is None:
            return filters, coefficients
        shares = torch.as_tensor(conditioning_weights(bits, self._between, self._sets)).to(
            filters[0]
        )

        def at(sets: Tensor, dimensions: int) -> Tensor:
            return sets if sets.dim() == dimensions else torch.tensordot(shares, sets, 1)

        filters = [at(sets, 4) for sets in filters]
        filters[0] = filters[0] / bits
        return filters, [None if sets is None else at(sets, 2) for sets in coefficients]

    def network(self) -> jotlight.Network:
        """Give a jotlight network with these parameters."""
        layers = [
            dataclasses.replace(
                layer,
                filters=_array(self.filters[index]),
                coefficients=None
                if layer.coefficients is None
                else _array(self.coefficients[str(index)]),
            )
            for index, layer in enumerate(self.origin.layers)
        ]
        origin = self.origin
        return jotlight.Network(
            layers, origin.sensor, origin.history, trials_range=origin.trials_range
        )


def _filtered(planes: Tensor, filters: Tensor, place: Place) -> Tensor:
    """D(h * u): equation (9), with a stride, and from depth to space."""
    # PyTorch's filters are turned around.
    sums = functional.conv2d(
        continued(planes, place.rows, place.columns), filters.flip(2, 3), stride=place.stride
    )
    return functional.pixel_shuffle(sums, place.upsampling) if place.upsampling > 1 else sums


def continued(planes: Tensor, rows: tuple[int, int], columns: tuple[int, int]) -> Tensor:
    """Continue planes past the rim by mirroring."""
    if not any((*rows, *columns)):
        return planes
    if max(*rows, *columns) == 1:
        return functional.pad(planes, (*columns, *rows), mode="replicate")
    for dimension, (before, after) in ((2, rows), (3, columns)):
        size = planes.shape[dimension]
        places = torch.arange(-before, size + after, device=planes.device) % (2 * size)
        planes = planes.index_select(dimension, places.minimum(2 * size - 1 - places))
    return planes


def _parameter(array: npt.NDArray[np.float32], learns: bool) -> nn.Parameter:
    return nn.Parameter(torch.from_numpy(array.copy()), requires_grad=learns)


def _array(parameter: Tensor) -> npt.NDArray[np.float32]:
    # A copy: what is learned further does not change it.
    return np.array(parameter.detach().cpu().numpy(), np.float32)
