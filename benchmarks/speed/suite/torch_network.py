"""Networks in PyTorch, with the fastest PyTorch operations for each step."""

from collections.abc import Callable

import numpy as np
import torch

import jotlight as jl
from jotlight.torch import Network
from suite.tasks.scene import counts, unpacked

Spline = Callable[[torch.Tensor, torch.Tensor, float, float], torch.Tensor]


class TorchNetwork:
    """A network of two layers and one channel, with its parameters as tensors."""

    def __init__(
        self, network: jl.Network, height: int, width: int, spline: Spline | None = None
    ) -> None:
        self.spline = spline or spline_by_interval
        first, second = network.layers
        self.tied = network.tied
        self.side = network.sensor.oversampling
        self.first = torch.from_numpy(first.filters.copy())
        self.phi1 = torch.from_numpy(first.coefficients[0].copy())
        self.second = torch.from_numpy(second.filters.copy())
        self.phi2 = torch.from_numpy(second.coefficients[0].copy())
        halo = self.second.shape[2] // 2
        # Symmetric padding repeats the border pixels, which PyTorch's padding modes do not.
        self.rows, self.columns = mirror_indices(height, halo), mirror_indices(width, halo)
        self.intervals = [(layer.start, layer.spacing) for layer in network.layers]

    @property
    def parameters(self) -> list[torch.Tensor]:
        return [self.first, self.phi1, self.second, self.phi2]

    def sums(self, bits: jl.Bits) -> torch.Tensor:
        """Return p of equation (11), or the counts for a tied network."""
        if self.tied:
            return counts_of(bits)
        return torch.nn.functional.conv2d(jots_of(bits), self.first, stride=self.side)

    def estimate(self, sums: torch.Tensor) -> torch.Tensor:
        p = self.first * sums if self.tied else sums
        u = self.spline(p, self.phi1, *self.intervals[0])
        padded = u[:, :, self.rows][:, :, :, self.columns]
        r = torch.nn.functional.conv2d(padded, self.second.flip(2, 3))
        return self.spline(r, self.phi2, *self.intervals[1])

    def reconstruct(self, bits: jl.Bits) -> np.ndarray:
        with torch.inference_mode():
            return self.estimate(self.sums(bits))[0, 0].numpy()


class DeepNetwork(Network):
    """The module, with splines by PyTorch's fastest operations for a forward pass."""

    channels_last = False
    """Whether the channels of a pixel are neighbors in memory."""

    def activate(
        self, index: int, sums: torch.Tensor, coefficients: torch.Tensor | None
    ) -> torch.Tensor:
        if coefficients is None:
            return sums
        if self.channels_last:
            sums = sums.contiguous(memory_format=torch.channels_last).permute(0, 2, 3, 1)
        spec, intervals = self.layer_specs[index], coefficients.shape[1] - 3
        first, f = interval_of(sums, intervals, spec.start, spec.spacing)
        cubics = coefficients.unfold(1, 4, 1) @ BASIS.to(coefficients.dtype)
        channel = torch.arange(len(cubics), dtype=torch.int32) * cubics.shape[1]
        if not self.channels_last:
            channel = channel.view(-1, 1, 1)
        first = (first.view(sums.shape) + channel).view(-1)
        a, b, c, d = cubics.view(-1, 4).index_select(0, first).view(*sums.shape, 4).unbind(-1)
        planes = ((d * f + c) * f + b) * f + a
        return planes.permute(0, 3, 1, 2) if self.channels_last else planes


def jots_of(bits: jl.Bits) -> torch.Tensor:
    return torch.from_numpy(unpacked(bits))[None].float()


def counts_of(bits: jl.Bits) -> torch.Tensor:
    return torch.from_numpy(counts(bits))[None, None]


def mirror_indices(size: int, halo: int) -> torch.Tensor:
    return torch.from_numpy(np.pad(np.arange(size), halo, mode="symmetric"))


def spline_by_interval(
    z: torch.Tensor, w: torch.Tensor, start: float, spacing: float
) -> torch.Tensor:
    """Return φ(z) by a cubic for each interval, PyTorch's fastest way for a forward pass."""
    first, f = interval_of(z, len(w) - 3, start, spacing)
    cubics = (w.unfold(0, 4, 1) @ BASIS).index_select(0, first).view(*z.shape, 4)
    a, b, c, d = cubics.unbind(-1)
    return ((d * f + c) * f + b) * f + a


def spline_by_weights(
    z: torch.Tensor, w: torch.Tensor, start: float, spacing: float, *, plain: bool = False
) -> torch.Tensor:
    """Return φ(z) by four coefficients for each number, by indices if `plain`.

    Without `plain` this is PyTorch's fastest way for a backward pass.
    """
    first, f = interval_of(z, len(w) - 3, start, spacing)
    g = 1 - f

    def weight(k: int) -> torch.Tensor:
        picked = w[first + k] if plain else w.index_select(0, first + k)
        return picked.view(z.shape)

    return (
        weight(0) * g**3 / 6
        + weight(1) * (2 / 3 + 0.5 * f * f * (f - 2))
        + weight(2) * (2 / 3 + 0.5 * g * g * (g - 2))
        + weight(3) * f**3 / 6
    )


def interval_of(
    z: torch.Tensor, intervals: int, start: float, spacing: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the interval of each number as a flat array, and its position in the interval."""
    position = ((z - start) * (1 / spacing)).clamp(0, intervals)
    first = position.detach().to(torch.int32).clamp_(max=intervals - 1)
    return first.reshape(-1), position - first


BASIS = torch.tensor(
    [[1 / 6, -0.5, 0.5, -1 / 6], [2 / 3, 0, -1, 0.5], [1 / 6, 0.5, 0.5, -0.5], [0, 0, 0, 1 / 6]]
)
"""The cubic B-spline on one interval: rows are coefficients, columns are powers."""
