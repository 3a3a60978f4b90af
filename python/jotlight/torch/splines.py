"""Cubic B-spline nonlinearities, differentiable in their input and in their coefficients.

On a CPU they run in the engine; on other devices, and for forward-mode derivatives, they consist of
PyTorch operations.
"""

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd import forward_ad

import jotlight._engine as engine
from jotlight.checks import whole_number
from jotlight.networks.splines import CUBIC_BASIS

_ROUNDING = 1e-3
"""Difference of knots that does not count, as of a state that was rounded to half precision."""


def spline(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
    """Return φ(z) = Σ_k w_k β3((z - start)/spacing - (k - 1)) per channel: equations (8), (10).

    Parameters
    ----------
    z : Tensor, shape (N, C, ...)
        Values of C channels, of any floating-point type.
    coefficients : Tensor, shape (C, N_w)
        w: at least 4 per channel.
    start, spacing : float
        First knot, and distance between knots. φ covers [start, start + (N_w - 3) spacing] and is
        constant outside.

    Returns
    -------
    Tensor, shape (N, C, ...)
        φ(z), of the type of z; NaN where z is NaN. It has derivatives of any order, also by
        `torch.func`. On a CPU, reverse-mode derivatives are faster than forward-mode ones.

    Raises
    ------
    TypeError
        When z or the coefficients are not floats.
    ValueError
        When z has no axis of channels, when there are fewer than 4 coefficients, or other channels
        than those of z, or when the spacing is not above 0.

    Examples
    --------
    >>> identity = torch.tensor([[-1.0, 0.0, 1.0, 2.0]])
    >>> spline(torch.tensor([[0.25], [0.5], [9.0]]), identity, 0.0, 1.0).flatten().tolist()
    [0.25, 0.5, 1.0]
    """
    _check(z, coefficients, spacing)
    if z.device.type != "cpu" or torch.onnx.is_in_onnx_export():
        return spline_reference(z, coefficients, start, spacing)
    dtype = torch.promote_types(z.dtype, torch.float32)
    coefficients = coefficients.to(dtype)
    # Of wrapped tensors, PyTorch does not tell which ones have a tangent.
    if forward_ad._current_level >= 0:
        return spline_reference(z, coefficients, start, spacing)
    values: Tensor = _Spline.apply(z.to(dtype), coefficients, float(start), float(spacing))
    return values.to(z.dtype)


def _check(z: Tensor, coefficients: Tensor, spacing: float) -> None:
    """Raise TypeError or ValueError for what is no spline, with one message for all devices."""
    for name, tensor in ("z", z), ("coefficients", coefficients):
        if not tensor.is_floating_point():
            raise TypeError(f"{name}: expected floats, got {tensor.dtype}; convert them to floats")
    if z.dim() < 2:
        raise ValueError(
            f"z: expected shape (N, C, ...), got {tuple(z.shape)}; for values of one channel, "
            "write z.reshape(-1, 1)"
        )
    channels = z.shape[1]
    if coefficients.dim() != 2 or coefficients.shape[0] != channels or coefficients.shape[1] < 4:
        raise ValueError(
            f"coefficients: expected shape (C, N_w) with the C = {channels} channels of z and at "
            f"least N_w = 4, got {tuple(coefficients.shape)}"
        )
    if not spacing > 0:
        raise ValueError(f"spacing: expected a distance above 0, got {spacing}")


def check_knots(state: Tensor, own: Tensor, source: str) -> None:
    """Raise ValueError for a state whose splines have other knots than a module.

    Parameters
    ----------
    state, own : Tensor, shape (L, 2)
        First knot and distance between knots of each layer: those of the state and of the module.
    source : str
        What to create the module from instead.

    Examples
    --------
    >>> check_knots(torch.tensor([[0.0, 1.0]]), torch.tensor([[0.0, 2.0]]), "the same knots")
    Traceback (most recent call last):
    ...
    ValueError: state_dict: expected splines with knots from 0 in steps of 2 for layer 0, got ...
    """
    if state.shape != own.shape:
        raise ValueError(
            f"state_dict: expected the knots of {len(own)} layers, got those of {len(state)}; "
            f"create the module from {source}"
        )
    # A state may have been rounded to a narrower type.
    equal = torch.isclose(state.to(own), own, rtol=_ROUNDING, atol=_ROUNDING).all(1)
    if not equal.all():
        index = int((~equal).nonzero()[0])
        (own_start, own_spacing), (start, spacing) = own[index].tolist(), state[index].tolist()
        raise ValueError(
            f"state_dict: expected splines with knots from {own_start:g} in steps of "
            f"{own_spacing:g} for layer {index}, got knots from {start:g} in steps of "
            f"{spacing:g}; create the module from {source}"
        )


def accept_parameters_alone(_: nn.Module, keys: Any) -> None:
    """Let `load_state_dict` take a dictionary of parameters, such as their averages.

    It has no extra state, so its knots are not compared.
    """
    keys.missing_keys[:] = [key for key in keys.missing_keys if not key.endswith("_extra_state")]


def spline_reference(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
    """Return what :func:`spline` returns, by PyTorch operations alone, on any device.

    Examples
    --------
    >>> identity = torch.tensor([[-1.0, 0.0, 1.0, 2.0]])
    >>> spline_reference(torch.tensor([[0.25], [0.5]]), identity, 0.0, 1.0).flatten().tolist()
    [0.25, 0.5]
    """
    channels, number = coefficients.shape
    intervals = number - 3
    basis = torch.tensor(CUBIC_BASIS, dtype=coefficients.dtype, device=coefficients.device) / 6
    cubics = (coefficients.unfold(1, 4, 1) @ basis).reshape(-1, 4)
    position = (z.to(coefficients.dtype) - start) / spacing
    # `clamp` would set the slope on the outermost knots to 0, too.
    position = torch.where(position < 0, 0, torch.where(position > intervals, intervals, position))
    knot = position.detach().floor().clamp(max=intervals - 1)
    t = position - knot
    offset = torch.arange(channels, device=z.device).view(-1, *[1] * (z.dim() - 2)) * intervals
    # NaN selects any interval; the result is NaN through t.
    index = knot.long().clamp(0, intervals - 1) + offset
    a, b, c, d = cubics[index].unbind(-1)
    return (((d * t + c) * t + b) * t + a).to(z.dtype)


@torch.library.custom_op("jotlight::spline", mutates_args=())
def _spline(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
    arrays = _channel_array(z), _array(coefficients)
    values = engine.activate(arrays, start, spacing, torch.get_num_threads())
    result = torch.from_numpy(values).view(z.shape)
    # The engine takes NaN for a number below the first knot, which would hide a failed training.
    # The sum is NaN if a value is, and takes far less time than a test of each value.
    return result.masked_fill(z.isnan(), math.nan) if z.sum().isnan() else result


@_spline.register_fake
def _(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
    return torch.empty(z.shape, dtype=z.dtype)


@torch.library.custom_op("jotlight::spline_backward", mutates_args=())
def _spline_backward(
    z: Tensor, gradient: Tensor, coefficients: Tensor, start: float, spacing: float
) -> tuple[Tensor, Tensor]:
    z_gradient, coefficients_gradient = engine.activate_backward(
        (_channel_array(z), _array(coefficients)),
        _channel_array(gradient),
        start,
        spacing,
        torch.get_num_threads(),
    )
    return (
        torch.from_numpy(z_gradient).view(z.shape),
        torch.from_numpy(coefficients_gradient).to(coefficients.dtype),
    )


@_spline_backward.register_fake
def _(
    z: Tensor, gradient: Tensor, coefficients: Tensor, start: float, spacing: float
) -> tuple[Tensor, Tensor]:
    return torch.empty(z.shape, dtype=z.dtype), torch.empty_like(coefficients)


# The autograd of operators excludes `torch.func`, and torch.compile excludes functions with `jvp`.
class _Spline(torch.autograd.Function):
    """φ(z) by the engine."""

    generate_vmap_rule = True

    @staticmethod
    def forward(z: Tensor, coefficients: Tensor, start: float, spacing: float) -> Tensor:
        values: Tensor = _spline(z, coefficients, start, spacing)
        return values

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Tensor) -> None:
        z, coefficients, ctx.start, ctx.spacing = inputs
        ctx.save_for_backward(z, coefficients)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor, None, None]:
        z, coefficients = ctx.saved_tensors
        gradients = _SplineBackward.apply(z, gradient, coefficients, ctx.start, ctx.spacing)
        return (*gradients, None, None)


class _SplineBackward(torch.autograd.Function):
    """The gradients of φ(z) by the engine. Their own gradients are those of the reference."""

    generate_vmap_rule = True

    @staticmethod
    def forward(
        z: Tensor, gradient: Tensor, coefficients: Tensor, start: float, spacing: float
    ) -> tuple[Tensor, Tensor]:
        gradients: tuple[Tensor, Tensor] = _spline_backward(
            z, gradient, coefficients, start, spacing
        )
        return gradients

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[Tensor, Tensor]) -> None:
        *tensors, ctx.start, ctx.spacing = inputs
        ctx.save_for_backward(*tensors)

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:
        def values(z: Tensor, coefficients: Tensor) -> Tensor:
            return spline_reference(z, coefficients, ctx.start, ctx.spacing)

        def gradients(z: Tensor, gradient: Tensor, coefficients: Tensor) -> Any:
            return torch.func.vjp(values, z, coefficients)[1](gradient)

        return (*torch.func.vjp(gradients, *ctx.saved_tensors)[1](cotangents), None, None)


def _array(tensor: Tensor) -> Any:
    return tensor.detach().contiguous().numpy()


def _channel_array(tensor: Tensor) -> Any:
    """Return an array (N, C, P) of P values per channel."""
    return _array(tensor).reshape(*tensor.shape[:2], math.prod(tensor.shape[2:]))


class Spline(nn.Module):
    """A trainable cubic B-spline per channel, which starts near max(z, 0).

    Parameters
    ----------
    channels : int
        C.
    coefficients : int
        N_w: coefficients per channel, at least 4.
    low, high : float
        First and last knot. The spline is constant outside.

    Raises
    ------
    TypeError, ValueError
        When there is no channel, when there are fewer than 4 coefficients, or when `high` is not
        above `low`.

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
        whole_number("channels", channels, 1)
        whole_number("coefficients", coefficients, 4)
        if not low < high:
            raise ValueError(f"low, high: expected low below high, got {low} and {high}")
        self.start, self.spacing = float(low), (high - low) / (coefficients - 3)
        centers = low + self.spacing * (torch.arange(coefficients) - 1)
        # A cubic B-spline whose coefficients lie on a line is that line.
        self.coefficients = nn.Parameter(centers.clamp(min=0).repeat(channels, 1))
        self.register_load_state_dict_post_hook(accept_parameters_alone)

    def get_extra_state(self) -> Tensor:
        """Return the knots, which `state_dict` holds beside the coefficients."""
        return torch.tensor([[self.start, self.spacing]], dtype=torch.float64, device="cpu")

    def set_extra_state(self, state: Tensor) -> None:
        """Raise ValueError for a state of a spline with other knots, in `load_state_dict`."""
        check_knots(state, self.get_extra_state(), "the same low and high")

    def forward(self, z: Tensor) -> Tensor:
        """Return φ(z), shape (N, C, ...)."""
        return spline(z, self.coefficients, self.start, self.spacing)

    def extra_repr(self) -> str:
        """Return the arguments of the spline, which PyTorch prints."""
        channels, number = self.coefficients.shape
        high = self.start + self.spacing * (number - 3)
        return f"{channels}, coefficients={number}, low={self.start:g}, high={high:g}"
