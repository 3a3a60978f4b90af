"""The cubic B-spline nonlinearity, differentiable in its input and its coefficients."""

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

import jotlight._engine as engine
from jotlight.networks.splines import CUBIC_BASIS

_BASIS = np.array(CUBIC_BASIS) / 6


def spline(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
    """φ(z) = Σ_k w_k β3((z - start)/spacing - (k - 1)) of each channel, equations (8) and (10).

    Parameters
    ----------
    z : Tensor, shape (N, C, ...)
    coefficients : Tensor, shape (C, N_w)
    start, spacing : float
        φ lives on [start, start + (N_w - 3) spacing] and is constant outside of it.

    Returns
    -------
    Tensor, shape (N, C, ...)
    """
    if z.device.type == "cpu":
        wide = torch.promote_types(z.dtype, torch.float32)
        bent: Tensor = _bend(z.to(wide), coefficients.to(wide), float(start), float(spacing))
        return bent.to(z.dtype)
    return formula(z, coefficients, start, spacing)


def formula(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
    """The same in operations of PyTorch alone, for any device."""
    channels, number = coefficients.shape
    intervals = number - 3
    basis = torch.as_tensor(_BASIS, dtype=coefficients.dtype, device=coefficients.device)
    cubics = (coefficients.unfold(1, 4, 1) @ basis).reshape(-1, 4)
    place = (z.to(coefficients.dtype) - start) / spacing
    # Clamping would take away the slope on the outermost knots, too.
    place = torch.where(place < 0, 0, torch.where(place > intervals, intervals, place))
    first = place.detach().floor().clamp(max=intervals - 1)
    through = place - first
    offset = torch.arange(channels, device=z.device).view(-1, *[1] * (z.dim() - 2)) * intervals
    # NaN has no place; it goes on through `through`.
    index = first.long().clamp(0, intervals - 1) + offset
    a, b, c, d = cubics[index].unbind(-1)
    return (((d * through + c) * through + b) * through + a).to(z.dtype)


@torch.library.custom_op("jotlight::bend", mutates_args=())
def _bend(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
    planes = _planes(z)
    out = engine.activate((planes, _array(coefficients)), start, spacing, torch.get_num_threads())
    return torch.from_numpy(out).view(z.shape)


@_bend.register_fake
def _(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
    return torch.empty(z.shape, dtype=z.dtype)


@torch.library.custom_op("jotlight::push", mutates_args=())
def _push(
    z: Tensor, gradient: Tensor, coefficients: Tensor, start: float, spacing: float
) -> tuple[Tensor, Tensor]:
    of_z, of_coefficients = engine.activate_backward(
        (_planes(z), _array(coefficients)),
        _planes(gradient),
        start,
        spacing,
        torch.get_num_threads(),
    )
    return (
        torch.from_numpy(of_z).view(z.shape),
        torch.from_numpy(of_coefficients).to(coefficients.dtype),
    )


@_push.register_fake
def _(
    z: Tensor, gradient: Tensor, coefficients: Tensor, start: float, spacing: float
) -> tuple[Tensor, Tensor]:
    return torch.empty(z.shape, dtype=z.dtype), torch.empty_like(coefficients)


def _remember(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
    z, coefficients, ctx.start, ctx.spacing = inputs
    ctx.save_for_backward(z, coefficients)


def _backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor, None, None]:
    z, coefficients = ctx.saved_tensors
    return (*_push(z, gradient, coefficients, ctx.start, ctx.spacing), None, None)


_bend.register_autograd(_backward, setup_context=_remember)


def _array(tensor: Tensor) -> Any:
    return tensor.detach().contiguous().numpy()


def _planes(tensor: Tensor) -> Any:
    """Channels in rows, (N, C, P)."""
    return _array(tensor).reshape(*tensor.shape[:2], math.prod(tensor.shape[2:]))


class Spline(nn.Module):
    """A pointwise cubic B-spline for each channel, to learn.

    Parameters
    ----------
    channels : int
    coefficients : int
        N_w of each channel, at least 4.
    low, high : float
        Where it bends; it is constant outside.

    Examples
    --------
    >>> relu = Spline(8)
    >>> relu(torch.zeros(2, 8, 5, 5)).shape
    torch.Size([2, 8, 5, 5])
    """

    def __init__(
        self, channels: int, coefficients: int = 13, low: float = -3.0, high: float = 3.0
    ) -> None:
        super().__init__()
        self.start, self.spacing = float(low), (high - low) / (coefficients - 3)
        places = low + self.spacing * (torch.arange(coefficients) - 1)
        # Coefficients on a line give the line.
        self.coefficients = nn.Parameter(places.clamp(min=0).repeat(channels, 1))

    def forward(self, z: Tensor) -> Tensor:
        """Give φ(z), (N, C, ...)."""
        return spline(z, self.coefficients, self.start, self.spacing)
