"""Bits of a single-photon camera, in packed form."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Self, SupportsIndex, overload

import numpy as np
import numpy.typing as npt

from jotlight.checks import refuse_masked, whole_number
from jotlight.errors import counted
from jotlight.progress import Progress
from jotlight.sensing.bits import byte_levels, lazy, preview
from jotlight.sensing.bits.bits_checks import check_fits, warn_about_axes, zeros_and_ones
from jotlight.sensing.bits.channels import channel_views
from jotlight.sensing.bits.counting import count_ones_of_one
from jotlight.sensing.bits.crop import OneFrame, Region, note_part, split_index
from jotlight.sensing.bits.frame_sequence import FrameSequence
from jotlight.sensing.bits.frames import (
    Frames,
    check_unpacked_size,
    frame_index,
    read_in_chunks,
)
from jotlight.sensing.bits.lazy import Chunks
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.sensor_like import SensorLike
from jotlight.sensing.parameters.slices import refuse_no_frames

if TYPE_CHECKING:
    import dask.array


class Bits(FrameSequence):
    """Bits of a single-photon camera, eight to a byte.

    They are equal if their values and their sensors are, wherever they come from.

    Parameters
    ----------
    packed : ndarray of uint8 or Frames, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
        The bits as ``numpy.packbits`` packs them along the width, the most significant bit first,
        as in photon cubes. :class:`jotlight.sensing.bits.frames.Frames` are read from files when
        they are needed. The bits are never unpacked as a whole.
    width : int, optional
        W: the true width in jots. Default: ``8 * packed.shape[2]``.
    sensor : Sensor, optional
        The sensor that recorded the bits, if known.
    provenance : jotlight.sensing.parameters.provenance.Provenance, optional
        The file that the bits come from, and what :func:`jotlight.open` assumed about it.
    tested_for_periods : bool
        Whether the bits need no test for the period of a mosaic: simulated bits do not, nor bits
        that were tested.

    Raises
    ------
    TypeError, ValueError
        When array, width, and sensor do not fit, or each byte without a width looks like a number.

    Examples
    --------
    >>> bits = jl.Bits(np.array([[[0b10100000]]], np.uint8), width=3)
    >>> bits.shape, bits.to_array().astype(int).tolist()
    ((1, 1, 3), [[[1, 0, 1]]])
    """

    def __init__(
        self,
        packed: npt.NDArray[np.uint8] | Frames,
        width: int | None = None,
        sensor: SensorLike | None = None,
        provenance: Provenance | None = None,
        *,
        tested_for_periods: bool = False,
    ) -> None:
        refuse_masked("packed", packed)
        if not isinstance(packed, np.ndarray | Frames) or packed.dtype != np.uint8:
            kind = getattr(packed, "dtype", type(packed).__name__)
            raise TypeError(
                f"packed: expected an array of uint8 with eight bits to a byte, got {kind}; "
                "Bits.from_array packs an array of 0 and 1"
            )
        if packed.ndim not in (3, 4) or packed.size == 0:
            raise ValueError(
                "packed: expected shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C), "
                f"without a dimension of 0, got {packed.shape}"
            )
        if width is None and isinstance(packed, np.ndarray):
            byte_levels.refuse_numbers(packed)
        full = 8 * packed.shape[2]
        self.packed = packed
        self.width = full if width is None else whole_number("width", width, 1)
        # A Sensor. Its module imports this one, so the type cannot be named here.
        self.sensor: Any | None = sensor
        self.provenance = provenance
        self.tested_for_periods = tested_for_periods
        if not full - 8 < self.width <= full:
            raise ValueError(
                f"width: expected {full - 7} to {full} for {packed.shape[2]} bytes a row, "
                f"got {width}"
            )
        if sensor is not None:
            check_fits(self.shape, sensor)

    @classmethod
    def from_array(cls, array: npt.ArrayLike, sensor: SensorLike | None = None) -> Self:
        """Return an array of bool, or of 0 and 1, as packed bits.

        Parameters
        ----------
        array : array_like of bool or int, shape (T, H, W), (H, W) or (T, H, W, C)
            The bits, with at most 4 channels.
        sensor : Sensor, optional
            The sensor that recorded the bits. Without it, a shape like (H, W, T) causes a warning.

        Raises
        ------
        TypeError, ValueError
            When the array has another type or shape, or holds other values.

        Examples
        --------
        >>> jl.Bits.from_array(np.eye(10, dtype=bool)).packed.shape
        (1, 10, 2)
        """
        values = zeros_and_ones(array)
        if sensor is None:
            warn_about_axes("bits", values.shape)
        return cls(np.packbits(values, axis=2), values.shape[2], sensor)

    @property
    def shape(self) -> tuple[int, ...]:
        """(T, H, W) or (T, H, W, C), in jots."""
        frames, height, _, *channels = self.packed.shape
        return (frames, height, self.width, *channels)

    @overload
    def __getitem__(self, index: SupportsIndex | OneFrame) -> npt.NDArray[np.bool_]: ...
    @overload
    def __getitem__(self, index: slice | tuple[slice, ...]) -> Self: ...

    def __getitem__(self, index: Any) -> npt.NDArray[np.bool_] | Self:
        """Return one frame as an array, or several, whose sensor has as many frames.

        ``bits[:, 10:40, 16:48]`` has some rows and columns of jots, and so have the maps and the
        mosaic of its sensor. Its pixels must be whole.

        Examples
        --------
        >>> bits = jl.Bits.from_array([[[0, 1]], [[1, 1]], [[1, 0]]])
        >>> bits[-1]
        array([[ True, False]])
        >>> bits[:2]
        <Bits: 2 frames of 1 x 2 jots>
        >>> bits[:2, :, 1:]
        <Bits: 2 frames of 1 x 1 jots>
        """
        frames, parts = split_index(index)
        if not isinstance(frames, slice):
            place = frame_index("bits", frames, len(self))
            return np.asarray(self[place:][(slice(1), *parts)].to_array()[0])
        refuse_no_frames("bits", frames, len(self))
        region = Region.of("bits", parts, self.shape, self.sensor)
        packed, width = self.packed[frames], self.width
        sensor = self.sensor and self.sensor.select_frames(frames)
        if region is not None:
            packed, width = region.crop_packed(packed), len(region.columns)
            sensor = sensor and region.crop_sensor(sensor)
        provenance = note_part(self.provenance, frames, region, self.shape)
        return self.replace(packed=packed, width=width, sensor=sensor, provenance=provenance)

    def replace(self, **changes: Any) -> Self:
        """Return the same bits with some arguments of :class:`Bits` replaced.

        Raises
        ------
        TypeError, ValueError
            When an argument is unknown, or the new ones do not fit together.

        Examples
        --------
        >>> bits = jl.Bits.from_array([[[0, 1]], [[1, 1]]])
        >>> bits.replace(packed=~bits.packed).to_array().astype(int).tolist()
        [[[1, 0]], [[0, 0]]]
        """
        names = "packed", "width", "sensor", "provenance", "tested_for_periods"
        arguments: dict[str, Any] = {name: getattr(self, name) for name in names}
        return type(self)(**{**arguments, **changes})

    def __iter__(self) -> Iterator[npt.NDArray[np.bool_]]:
        """Yield each frame as an array, (H, W) or (H, W, C)."""
        for _, part in read_in_chunks(self.packed):
            yield from np.unpackbits(part, axis=2, count=self.width).view(np.bool_)

    def __array__(
        self, dtype: npt.DTypeLike | None = None, copy: bool | None = None
    ) -> npt.NDArray[Any]:
        """Return :meth:`to_array`, for ``numpy.asarray``."""
        if copy is False:
            raise ValueError("copy=False: packed bits can only be unpacked into a new array")
        dtype = np.dtype(np.bool_ if dtype is None else dtype)
        check_unpacked_size(self.shape, dtype.itemsize)
        return self.to_array().astype(dtype, copy=False)

    def to_array(self) -> npt.NDArray[np.bool_]:
        """Return unpacked bits of bool, (T, H, W) or (T, H, W, C). They take 8 times the memory.

        Raises
        ------
        MemoryError
            When they exceed the available memory.
        """
        check_unpacked_size(self.shape)
        return np.unpackbits(np.asarray(self.packed), axis=2, count=self.width).view(np.bool_)

    def counts(
        self,
        oversampling: int | None = None,
        *,
        mask: npt.NDArray[np.bool_] | None = None,
        out: npt.NDArray[np.int32] | None = None,
        threads: int | None = None,
        progress: Progress = False,
    ) -> npt.NDArray[np.int32]:
        """Return L, the number of ones of each pixel, counted without unpacking the bits.

        Parameters
        ----------
        oversampling : int, optional
            K̂. Default: that of the bits' own sensor, or 1 if they have none.
        mask : ndarray of bool, shape (H, W) in jots, optional
            True marks jots that are not counted.
        out : ndarray of int32, optional
            An array of the shape of the result to write to and return. Default: a new one.
        threads : int, optional
            The number of threads. Default: the number of cores.
        progress : bool or callable, optional
            Whether to show a progress bar, or a function that is called repeatedly with the
            completed fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

        Returns
        -------
        ndarray of int32, shape (H / K̂, W / K̂) or (H / K̂, W / K̂, C)

        Raises
        ------
        TypeError, ValueError
            When K̂ is not a whole number that divides height and width, or the mask or `out` does
            not fit.

        Examples
        --------
        >>> jl.Bits.from_array(np.ones((3, 4, 4), bool)).counts(2).tolist()
        [[12, 12], [12, 12]]
        """
        if oversampling is None:
            oversampling = self.sensor.oversampling if self.sensor else 1
        return count_ones_of_one(self, oversampling, mask, out, threads, progress)

    def to_dask(self, chunks: Chunks = "128MiB") -> dask.array.Array:
        """Return the packed bits as a lazy array of dask, chunked in time (extra `dask`).

        Parameters
        ----------
        chunks : str, int, or tuple
            Maximum size of a chunk, such as ``"128MiB"``; or its number of frames; or its shape,
            such as ``(1000, -1, -1)``. A chunk holds whole frames.

        Returns
        -------
        dask.array.Array of uint8, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
            Workers open the files themselves. Bits in memory become part of the graph. The array
            does not state W, so the functions of :mod:`jotlight.dask` need ``width=bits.width``.
            dask reads chunks in any order, which takes long in files that are compressed as a
            whole, such as `.npy.gz`; :func:`jotlight.save` makes a `.npy` of them.

        Raises
        ------
        MissingExtraError
            When dask is not installed.
        TypeError, ValueError
            When a chunk does not hold whole frames.

        Examples
        --------
        >>> bits = jl.Bits.from_array(np.ones((100, 16, 16), bool))
        >>> bits.to_dask(chunks=40).chunks[0]
        (40, 40, 20)
        """
        return lazy.to_dask(self.packed, chunks)

    def channels(self) -> list[Self]:
        """Return the bits of each channel, (T, H, W). Gray bits are themselves the only channel."""
        if len(self.shape) == 3:
            return [self]
        return [self.replace(packed=packed) for packed in channel_views(self.packed, 3)]

    def show(self, *, viewer: bool = False) -> None:
        """Show how often each pixel is 1, with matplotlib. Only the first 64 MiB are read.

        Parameters
        ----------
        viewer : bool
            Whether to open a viewer with a slider instead: napari if it is installed and can show
            windows, and else the page of ``jotlight view``, whose address is printed. A program
            waits until napari is closed, or until Ctrl-C ends the page. A notebook or a console
            goes on.
        """
        if viewer:
            preview.open_viewer(self)
        else:
            preview.show(self)

    def _repr_html_(self) -> str:
        return preview.html_of(self)

    def __repr__(self) -> str:
        frames, height, width, *channels = self.shape
        color = f" x {channels[0]} channels" if channels else ""
        sensor = f", {self.sensor!r}" if self.sensor else ""
        number = counted(frames, "frame")
        return f"<Bits: {number} of {height} x {width} jots{color}{sensor}>"
