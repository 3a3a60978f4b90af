"""The number of ones of each pixel, counted without unpacking the bits."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Packed
from jotlight.checks import check_threads, refuse_masked
from jotlight.chunks import frame_chunks
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.bits.bits_checks import checked_oversampling
from jotlight.sensing.bits.channels import channel_views
from jotlight.sensing.bits.frames import Frames, map_in_thread, read_chunks
from jotlight.sensing.bits.output_images import check_out

_MAX_JOTS_IN_MEMORY = 1 << 32
"""Maximum number of jots of bits in memory that are counted at a time: 512 MiB. The engine needs
less than a tenth of a second for them, and counts many frames of a jot faster than few."""


class PackedBits(Protocol):
    """Packed bits, such as :class:`jotlight.Bits`."""

    @property
    def packed(self) -> Packed | Frames:
        """(T, H, ceil(W / 8)), or (T, H, ceil(W / 8), C)."""

    @property
    def width(self) -> int:
        """W."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(T, H, W), or (T, H, W, C)."""


def count_ones(
    bits: Sequence[PackedBits],
    oversampling: int,
    mask: npt.NDArray[np.bool_] | None = None,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
    out: npt.NDArray[np.int32] | None = None,
) -> npt.NDArray[np.int32]:
    """Return L, the number of ones of each pixel, for the bits of several images.

    Parameters
    ----------
    bits : sequence of Bits
        The bits of N images, of the same shape. Bits in memory are counted together.
    oversampling : int
        K̂.
    mask : ndarray of bool, shape (H, W) in jots, optional
        True marks jots that are not counted.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : callable, optional
        A function that is called repeatedly with the completed fraction, from 0 to 1.
    out : ndarray of int32, optional
        The aligned array for the result, which is returned. Default: a new one.

    Returns
    -------
    ndarray of int32, shape (N, H / K̂, W / K̂) or (N, H / K̂, W / K̂, C)

    Raises
    ------
    TypeError, ValueError
        When the height or the width is not a multiple of K̂, or the mask does not fit.

    Examples
    --------
    >>> count_ones([jl.Bits.from_array(np.ones((3, 4, 4), bool))], 2).tolist()
    [[[12, 12], [12, 12]]]
    """
    check_threads(threads)
    frames, height, width, *channels = bits[0].shape
    oversampling = _check(frames, (height, width), oversampling, mask)
    valid = None if mask is None else np.packbits(~mask, axis=1)
    shape = height // oversampling, width // oversampling, *channels
    counts = np.zeros((len(bits), *shape), np.int32) if out is None else out
    if out is not None:
        out[...] = 0
    # Files are read one after another, because memory may not hold all of them.
    in_files = any(isinstance(one.packed, Frames) for one in bits)
    number = 1 if in_files else len(bits)
    max_jots = None if in_files else _MAX_JOTS_IN_MEMORY
    chunks = list(frame_chunks(frames, shape[0], number * width * oversampling, max_jots))
    for first in range(0, len(bits), number):
        group, out = bits[first : first + number], counts[first : first + number]

        def add(parts: tuple[tuple[range, Packed], ...], out: npt.NDArray[np.int32] = out) -> None:
            rows = parts[0][0]
            jots = slice(rows.start * oversampling, rows.stop * oversampling)
            views = [channel_views(part[:, jots], 3) for _, part in parts]
            ones = channel_views(out[:, rows.start : rows.stop], 3)
            masked = None if valid is None else valid[jots]
            for channel, place in enumerate(ones):
                packed = [view[channel] for view in views]
                engine.add_block_counts(packed, width, oversampling, masked, place, threads)

        # Reading a file takes as long as counting, and the two overlap.
        run = map_in_thread if in_files else map
        readers = [read_chunks(one.packed, chunks) for one in group]
        for index, _ in enumerate(run(add, zip(*readers, strict=True))):
            if progress:
                progress((first + number * (index + 1) / len(chunks)) / len(bits))
    return counts


def count_ones_of_one(
    bits: PackedBits,
    oversampling: int,
    mask: npt.NDArray[np.bool_] | None,
    out: npt.NDArray[np.int32] | None,
    threads: int | None,
    progress: Progress,
) -> npt.NDArray[np.int32]:
    """Return L of the bits of one image, in `out` if there is such an array.

    Raises
    ------
    TypeError, ValueError
        When the mask, the oversampling, or `out` does not fit.
    """
    frames, height, width, *channels = bits.shape
    oversampling = _check(frames, (height, width), oversampling, mask)
    target = None
    if out is not None:
        shape = height // oversampling, width // oversampling, *channels
        checked = check_out(out, shape, np.int32)
        target = checked[None] if checked.flags.aligned else None
    counts: npt.NDArray[np.int32]
    with shown_progress(progress, "counting") as update:
        [counts] = count_ones([bits], oversampling, mask, threads, update, target)
    if out is None or target is not None:
        return counts if out is None else out
    out[...] = counts
    return out


def _check(
    frames: int, jots: tuple[int, int], oversampling: int, mask: npt.NDArray[np.bool_] | None
) -> int:
    """Return the oversampling as an int, after checks of it and of the mask."""
    oversampling = checked_oversampling(oversampling, jots)
    if frames * oversampling**2 >= 2**31:
        raise ValueError(
            f"bits: expected fewer than 2**31 trials per pixel, got {frames} frames of "
            f"{oversampling} x {oversampling} jots; count parts of the frames: bits[a:b]"
        )
    check_mask(mask, jots)
    return oversampling


def check_mask(mask: npt.NDArray[np.bool_] | None, jots: tuple[int, ...]) -> None:
    """Raise ValueError unless a mask is None, or has a bool for each jot.

    Examples
    --------
    >>> check_mask(np.zeros((2, 3), bool), (2, 3))
    >>> check_mask(np.zeros((2, 3), int), (2, 3))
    Traceback (most recent call last):
      ...
    ValueError: mask: expected bool of shape (2, 3), got int64 of shape (2, 3)
    """
    refuse_masked("mask", mask, "pass mask.filled(True), where True marks dead jots")
    if mask is not None and (mask.dtype != np.bool_ or mask.shape != jots):
        raise ValueError(
            f"mask: expected bool of shape {jots}, got {mask.dtype} of shape {mask.shape}"
        )
