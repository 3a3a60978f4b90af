"""The network as a module of PyTorch, built from and written back to the same file."""

import dataclasses

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn
from torch.nn import functional

import jotlight
from jotlight.layer import Layer, number_of_sets, shares_of, sources, step_of
from jotlight.torch.spline import spline


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
        self._sources, self._step = sources(layers), step_of(layers)
        self.filters = nn.ParameterList(
            _parameter(layer.filters, layer.learns != "nothing") for layer in layers
        )
        self.coefficients = nn.ParameterDict(
            {
                str(index): _parameter(layer.coefficients, layer.learns == "all")
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
        return self._bent(-1, self.sums(data, bits), self._parameters_at(bits)[1][-1])

    def sums(self, data: Tensor, bits: int | None = None) -> Tensor:
        """Give what the last spline makes the pictures of, (N, 1, H, W)."""
        filters, coefficients = self._parameters_at(bits)
        side = 1 if self.origin.tied else self.origin.sensor.oversampling
        sums = functional.conv2d(data.to(filters[0].dtype), filters[0], stride=side)
        height, width = sums.shape[-2:]
        sums = continued(sums, (0, -height % self._step), (0, -width % self._step))
        planes: list[Tensor] = []
        for index, layer in enumerate(self.origin.layers):
            if index:
                planes.append(self._bent(index - 1, sums, coefficients[index - 1]))
                sums = _filtered(planes[self._sources[index]], filters[index], layer)
            if layer.adds is not None:
                sums = sums + planes[layer.adds]
        return sums[..., :height, :width]

    def _bent(self, index: int, sums: Tensor, coefficients: Tensor | None) -> Tensor:
        if coefficients is None:
            return sums
        layer = self.origin.layers[index]
        return spline(sums, coefficients, layer.start, layer.spacing)

    def _parameters_at(self, bits: int | None) -> tuple[list[Tensor], list[Tensor | None]]:
        """Filters and coefficients of the layers, where the network is told K."""
        between, layers = self.origin.bits, self.origin.layers
        if (between is None) != (bits is None):
            raise ValueError(
                "bits: expected K for a network that is told it, and only for such a network, got "
                f"{bits}"
            )
        filters: list[Tensor] = list(self.filters)
        coefficients = [
            None if layer.coefficients is None else self.coefficients[str(index)]
            for index, layer in enumerate(layers)
        ]
        if between is None or bits is None:
            return filters, coefficients
        shares = torch.as_tensor(shares_of(bits, between, number_of_sets(layers))).to(filters[0])

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
        return jotlight.Network(layers, origin.sensor, origin.history, bits=origin.bits)


def _filtered(planes: Tensor, filters: Tensor, layer: Layer) -> Tensor:
    """D(h * u): equation (9), with a stride, and from depth to space."""
    rows, columns = (
        (before, size - layer.stride - before)
        for before, size in zip(layer.before, layer.shape[2:], strict=True)
    )
    # PyTorch's filters are turned around.
    sums = functional.conv2d(
        continued(planes, rows, columns), filters.flip(2, 3), stride=layer.stride
    )
    return functional.pixel_shuffle(sums, layer.upsampling) if layer.upsampling > 1 else sums


def continued(planes: Tensor, rows: tuple[int, int], columns: tuple[int, int]) -> Tensor:
    """Continue planes past the rim by mirroring."""
    if not any((*rows, *columns)):
        return planes
    if max(*rows, *columns) == 1:
        return functional.pad(planes, (*columns, *rows), mode="replicate")
    for dimension, (before, after) in ((2, rows), (3, columns)):
        size = planes.shape[dimension]
        places = np.arange(-before, size + after) % (2 * size)
        places = np.minimum(places, 2 * size - 1 - places)
        planes = planes.index_select(dimension, torch.from_numpy(places).to(planes.device))
    return planes


def _parameter(array: npt.NDArray[np.float32], learns: bool) -> nn.Parameter:
    return nn.Parameter(torch.from_numpy(array.copy()), requires_grad=learns)


def _array(parameter: Tensor) -> npt.NDArray[np.float32]:
    # A copy: what is learned further does not change it.
    return np.array(parameter.detach().cpu().numpy(), np.float32)
