"""The two-layer network in PyTorch."""

import numpy as np
import torch

import jotlight as jl
from suite.paths.scene import unpacked


class TorchNetwork:
    """A network of two layers and one channel, with its parameters as tensors."""

    def __init__(self, network: jl.Network, height: int, width: int) -> None:
        first, second = network.layers
        self.tied = network.tied
        self.side = network.sensor.oversampling
        self.first = torch.from_numpy(first.filters.copy())
        self.phi1 = torch.from_numpy(first.coefficients[0].copy())
        self.second = torch.from_numpy(second.filters.copy())
        self.phi2 = torch.from_numpy(second.coefficients[0].copy())
        halo = self.second.shape[2] // 2
        # Symmetric continuation repeats the rim, which PyTorch's padding modes do not.
        self.rows, self.columns = mirrored(height, halo), mirrored(width, halo)
        self.intervals = [(layer.start, layer.spacing) for layer in network.layers]

    @property
    def parameters(self) -> list[torch.Tensor]:
        return [self.first, self.phi1, self.second, self.phi2]

    def sums(self, bits: jl.Bits) -> torch.Tensor:
        """Give p, or of a tied network the counts."""
        jots = torch.from_numpy(unpacked(bits))[None].float()
        if self.tied:
            # The quickest of PyTorch's ways to add up a block.
            return torch.nn.functional.avg_pool2d(jots, self.side, divisor_override=1)
        return torch.nn.functional.conv2d(jots, self.first, stride=self.side)

    def picture(self, sums: torch.Tensor) -> torch.Tensor:
        p = self.first * sums if self.tied else sums
        u = spline(p, self.phi1, *self.intervals[0])
        padded = u[:, :, self.rows][:, :, :, self.columns]
        r = torch.nn.functional.conv2d(padded, self.second.flip(2, 3))
        return spline(r, self.phi2, *self.intervals[1])

    def reconstruct(self, bits: jl.Bits) -> np.ndarray:
        with torch.inference_mode():
            return self.picture(self.sums(bits))[0, 0].numpy()


def mirrored(size: int, halo: int) -> torch.Tensor:
    return torch.from_numpy(np.pad(np.arange(size), halo, mode="symmetric"))


def spline(z: torch.Tensor, w: torch.Tensor, start: float, spacing: float) -> torch.Tensor:
    place = ((z - start) / spacing).clamp(0, len(w) - 3)
    first = place.detach().floor().clamp(max=len(w) - 4).long()
    f = place - first
    g = 1 - f
    return (
        w[first] * g**3 / 6
        + w[first + 1] * (2 / 3 + 0.5 * f * f * (f - 2))
        + w[first + 2] * (2 / 3 + 0.5 * g * g * (g - 2))
        + w[first + 3] * f**3 / 6
    )
