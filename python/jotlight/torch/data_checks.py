"""Checks of the values that a network receives as a tensor, with the messages of the engine."""

import torch
from torch import Tensor

from jotlight.errors import warn
from jotlight.sensing.data.scaled_counts import range_error
from jotlight.sensing.parameters.intensity_scale import warn_about_scale
from jotlight.sensing.sensor import Sensor

_UNORDERED = torch.uint16, torch.uint32, torch.uint64
"""Types for which PyTorch has no `aminmax`."""


def check_intensities(intensities: Tensor) -> None:
    """Raise TypeError unless intensities are a tensor of floats, as in :meth:`Sensor.expose`.

    Examples
    --------
    >>> check_intensities(torch.zeros(1, 1, 2, 2, dtype=torch.uint8))
    Traceback (most recent call last):
    ...
    TypeError: intensities: expected floats in units of intensity, got torch.uint8; ...
    """
    if not isinstance(intensities, Tensor):
        raise TypeError(
            f"intensities: expected a tensor (N, 1, H, W), got {type(intensities).__name__}; pass "
            "torch.as_tensor(image)[None, None] for an image (H, W)"
        )
    if not intensities.is_floating_point():
        raise TypeError(
            f"intensities: expected floats in units of intensity, got {intensities.dtype}; divide "
            "by the level of white, such as image / 255 for an 8-bit photograph"
        )


def shape_advice(name: str, images: Tensor) -> str:
    """Return the end of a message about a shape that is not (N, 1, H, W): how to convert it.

    Examples
    --------
    >>> shape_advice("data", torch.zeros(5, 6))
    '; for one image, write data[None, None]'
    >>> shape_advice("data", torch.zeros(2, 5, 6))
    '; for images (N, H, W), write data[:, None]'
    """
    if images.dim() == 2:
        return f"; for one image, write {name}[None, None]"
    if images.dim() == 3:
        return f"; for images (N, H, W), write {name}[:, None]"
    if images.dim() == 4 and images.shape[1] > 1:
        return (
            "; channels are images of their own: for (N, C, H, W), write "
            f"{name}.flatten(0, 1)[:, None]"
        )
    return ""


def check_data(data: Tensor, sensor: Sensor, side: int, *, is_bits: bool) -> None:
    """Raise TypeError or ValueError for data that a network cannot take from a sensor.

    Parameters
    ----------
    data : Tensor
        Counts (N, 1, H, W) or bits (N, T, H·K̂, W·K̂).
    sensor : Sensor
        Sensor of the data.
    side : int
        Rows and columns of the data per pixel: 1 for counts, K̂ for bits.
    is_bits : bool
        Whether the data are bits instead of counts.

    Warns
    -----
    JotlightWarning
        As :func:`check_values`.

    Examples
    --------
    >>> check_data(torch.zeros(5, 6), jl.Sensor(), 1, is_bits=False)
    Traceback (most recent call last):
    ...
    ValueError: data: expected counts (N, 1, H, W) ... got shape (5, 6); ... data[None, None]
    """
    channels = sensor.frames if is_bits else 1
    bits = f"bits (N, {channels}, H·K̂, W·K̂) with K̂ = {side}"
    kind = bits if is_bits else "counts (N, 1, H, W)"
    if not isinstance(data, Tensor):
        raise TypeError(
            f"data: expected a tensor of {kind}, got {type(data).__name__}; "
            "for an image of counts, write torch.from_numpy(counts)[None, None]"
        )
    is_batch = data.dim() == 4 and data.shape[1] == channels
    if not is_batch or any(size % side or not size for size in data.shape[2:]):
        hint = "" if is_bits else shape_advice("data", data)
        raise ValueError(
            f"data: expected {kind} and at least one pixel, got shape {tuple(data.shape)}{hint}"
        )
    check_values(data, sensor, is_bits=is_bits)


def refuse_tracing() -> None:
    """Raise RuntimeError under torch.jit.trace: choices by values and sizes become constants.

    The exporter of ONNX models also traces; it is not refused.
    """
    is_tracing = torch.jit.is_tracing  # type: ignore[attr-defined, unused-ignore]
    if torch.compiler.is_compiling() or not is_tracing():
        return
    if not torch.onnx.is_in_onnx_export():
        raise RuntimeError(
            "torch.jit.trace: expected a module without choices by the values of its data, got a "
            "jotlight network; use torch.compile(network), or "
            "network.to_network().export_onnx(path) for other programs"
        )


def as_floats(data: Tensor) -> Tensor:
    """Return counts, bits, or intensities of any number type as floats, at least float32.

    Sums and products of narrower types would overflow or be rounded.

    Examples
    --------
    >>> [as_floats(torch.zeros(1, dtype=t)).dtype for t in (torch.bool, torch.half, torch.double)]
    [torch.float32, torch.float32, torch.float64]
    """
    return data.to(torch.promote_types(data.dtype, torch.float32))


def warn_about_levels(intensities: Tensor, max_intensity: float) -> None:
    """Warn about intensities that look like gray levels, as :meth:`Sensor.expose` does.

    Nothing is checked where :func:`check_values` checks nothing.
    """
    if torch.compiler.is_compiling() or intensities.requires_grad or intensities.numel() == 0:
        return
    try:
        is_bright = float(intensities.amax()) > max_intensity
    except RuntimeError:  # the tensor has no values, as on "meta" or under torch.vmap
        return
    if is_bright:
        warn_about_scale("intensities", [intensities.float().cpu().numpy()], max_intensity)


def check_values(data: Tensor, sensor: Sensor, *, is_bits: bool) -> None:
    """Raise ValueError for counts or bits that a sensor cannot report.

    Numbers need not be whole, since expected counts are legal. Nothing is checked when the data
    need gradients, under torch.compile and torch.export, or when a tensor has no values to read, as
    on the device "meta".

    Parameters
    ----------
    data : Tensor
        Counts or bits, of any number type.
    sensor : Sensor
        Sensor of the data.
    is_bits : bool
        Whether the data are bits instead of counts.

    Warns
    -----
    JotlightWarning
        When numbers from 0 to 1 look like means in place of counts.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=8)
    >>> check_values(torch.tensor([[0.0, 7.5]]), sensor, is_bits=False)
    >>> check_values(torch.tensor([[0.0, 9.0]]), sensor, is_bits=False)
    Traceback (most recent call last):
    ...
    ValueError: counts: expected 0 to K = 8 ones per pixel (8 frames of 1 x 1 jots), got 0 to 9
    """
    if torch.compiler.is_compiling() or data.requires_grad or data.numel() == 0:
        return
    if data.dtype in _UNORDERED:
        data = data.long()
    try:
        low, high = (float(value) for value in torch.stack(torch.aminmax(data)).tolist())
    except RuntimeError:  # the tensor has no values, as on "meta" or under torch.vmap
        return
    limit = 1 if is_bits else sensor.trials
    # Counts of a narrow type, and sums of probabilities, are rounded.
    slack = 4 * limit * torch.finfo(data.dtype).eps if data.is_floating_point() else 0
    if not -slack <= low <= high <= limit + slack:
        if is_bits:
            raise ValueError(f"bits: expected 0 and 1, got {low:g} to {high:g}")
        values = data.double().cpu().numpy()
        raise range_error(values, sensor)
    if high <= 1 < limit and data.is_floating_point() and bool((data != data.round()).any()):
        warn(
            f"counts: the values look like means, because they are from {low:g} to {high:g} and "
            f"not whole; the network expects counts from 0 to K = {limit}: multiply means by K"
        )
