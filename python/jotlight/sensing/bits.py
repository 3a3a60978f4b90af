"""The data: bits in packed form."""

import operator
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import refuse_masked
from jotlight.chunks import JOTS_PER_COUNT, frame_chunks
from jotlight.memory_maps import release
from jotlight.sensing.frames import Frames, range_of
from jotlight.sensing.provenance import Source

if TYPE_CHECKING:
    from jotlight.sensing.sensor import Sensor


class Bits:
    """Bits of a single-photon camera, eight to a byte.

    Parameters
    ----------
    packed : ndarray of uint8 or Frames, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
        The layout of ``numpy.packbits`` along the width, most significant bit first, as photon
        cubes have it. May be a memory map, or :class:`jotlight.sensing.frames.Frames` that are read from
        files as they are needed; it is never unpacked whole.
    width : int, optional
        The true width W in jots. Default: ``8 * packed.shape[2]``.
    sensor : Sensor, optional
        What made the bits, where it is known.
    source : jotlight.sensing.provenance.Source, optional
        The file they are from and what was assumed of it, which :func:`jotlight.open` tells.

    Raises
    ------
    TypeError, ValueError
        When the array or the width do not fit.

    Examples
    --------
    >>> bits = Bits(np.array([[[0b10100000]]], np.uint8), width=3)
    >>> bits.shape, bits.to_array().astype(int).tolist()
    ((1, 1, 3), [[[1, 0, 1]]])
    """

    def __init__(
        self,
        packed: npt.NDArray[np.uint8] | Frames,
        width: int | None = None,
        sensor: "Sensor | None" = None,
        source: Source | None = None,
    ) -> None:
        if not isinstance(packed, np.ndarray | Frames) or packed.dtype != np.uint8:
            given = getattr(packed, "dtype", type(packed).__name__)
            raise TypeError(
                f"packed: expected an array of uint8 with eight bits to a byte, got {given}; "
                "Bits.from_array packs an array of 0 and 1"
            )
        if packed.ndim not in (3, 4) or packed.size == 0:
            raise ValueError(
                "packed: expected shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C), "
                f"none of it 0, got {packed.shape}"
            )
        full = 8 * packed.shape[2]
        self.packed = packed
        self.width = full if width is None else operator.index(width)
        self.sensor = sensor
        self.source = source
        if not full - 8 < self.width <= full:
            raise ValueError(
                f"width: expected {full - 7} to {full} for {packed.shape[2]} bytes a row, "
                f"got {width}"
            )
        if sensor is not None:
            check_fits(self, sensor)

    @classmethod
    def from_array(cls, array: npt.ArrayLike, sensor: "Sensor | None" = None) -> Self:
        """Pack an array of bool, or of 0 and 1, of shape (T, H, W), (H, W) or (T, H, W, C).

        Examples
        --------
        >>> Bits.from_array(np.eye(10, dtype=bool)).packed.shape
        (1, 10, 2)
        """
        refuse_masked("bits", array)
        values = np.asarray(array)
        if values.dtype.kind not in "biu":
            raise TypeError(f"bits: expected bool or whole numbers 0 and 1, got {values.dtype}")
        if values.ndim == 2:
            values = values[None]
        if values.ndim not in (3, 4) or values.size == 0:
            raise ValueError(
                "bits: expected shape (T, H, W), (H, W) or (T, H, W, C), none of it 0, "
                f"got {values.shape}"
            )
        if values.dtype != np.bool_ and (values.min() < 0 or values.max() > 1):
            raise ValueError(
                f"bits: expected 0 and 1 only, got {values.min()} to {values.max()}; "
                "methods take an image of counts as it is"
            )
        return cls(np.packbits(values, axis=2), values.shape[2], sensor)

    @property
    def shape(self) -> tuple[int, ...]:
        """(T, H, W) or (T, H, W, C), in jots."""
        frames, height, _, *channels = self.packed.shape
        return (frames, height, self.width, *channels)

    def __len__(self) -> int:
        """The number of frames."""
        return int(self.packed.shape[0])

    def __getitem__(self, frames: slice) -> Self:
        """Some of the frames, as a view; the sensor it carries then has that many."""
        if not isinstance(frames, slice):
            raise TypeError(f"bits: expected a slice of frames such as bits[:16], got {frames!r}")
        packed = self.packed[frames]
        if len(packed) == 0:
            raise ValueError(f"bits: no frames in {range_of(frames)} of {len(self)}")
        sensor = self.sensor and self.sensor.replace(frames=len(packed))
        source = self.source
        if source is not None and len(packed) < len(self):
            start, stop, step = frames.indices(len(self))
            taken = range_of(slice(start, stop, None if step == 1 else step))
            source = source.with_note(f"frames {taken} of {len(self)}")
        return type(self)(packed, self.width, sensor, source)

    def to_array(self) -> npt.NDArray[np.bool_]:
        """Unpack into bool, (T, H, W) or (T, H, W, C): eight times the memory."""
        return np.unpackbits(np.asarray(self.packed), axis=2, count=self.width).view(np.bool_)

    def counts(
        self,
        oversampling: int | None = None,
        *,
        mask: npt.NDArray[np.bool_] | None = None,
        threads: int | None = None,
        progress: Callable[[float], object] | None = None,
    ) -> npt.NDArray[np.int32]:
        """L: the ones among each pixel's bits, counted in the packed domain.

        Parameters
        ----------
        oversampling : int, optional
            K̂. Default: that of the sensor which the bits carry, or 1 when they carry none.
        mask : ndarray of bool, shape (H, W) in jots, optional
            True marks jots that are left out.
        threads : int, optional
            Threads to use. Default: all.
        progress : callable, optional
            Called now and then with the share that is done.

        Returns
        -------
        ndarray of int32, shape (H / K̂, W / K̂) or (H / K̂, W / K̂, C)

        Examples
        --------
        >>> Bits.from_array(np.ones((3, 4, 4), bool)).counts(2).tolist()
        [[12, 12], [12, 12]]
        """
        if oversampling is None:
            oversampling = self.sensor.oversampling if self.sensor else 1
        frames, height, width, *channels = self.shape
        if oversampling < 1 or height % oversampling or width % oversampling:
            raise ValueError(
                f"bits: expected rows and columns of jots that are multiples of the oversampling "
                f"{oversampling}, got {height} x {width}"
            )
        if mask is not None and (mask.dtype != np.bool_ or mask.shape != (height, width)):
            raise ValueError(
                f"mask: expected bool of shape {(height, width)}, "
                f"got {mask.dtype} of shape {mask.shape}"
            )
        valid = None if mask is None else np.packbits(~mask, axis=1)
        counts = np.zeros((height // oversampling, width // oversampling, *channels), np.int32)
        slabs = list(frame_chunks(frames, counts.shape[0], width * oversampling, JOTS_PER_COUNT))
        planes = [counts[..., c] for c in range(channels[0])] if channels else [counts]
        for index, (f, r) in enumerate(slabs):
            jots = slice(r.start * oversampling, r.stop * oversampling)
            # Read once for all channels, where it comes from files.
            part = self.packed[f.start : f.stop, jots]
            for channel, plane in enumerate(planes):
                engine.add_block_counts(
                    part[..., channel] if channels else part,
                    width,
                    oversampling,
                    None if valid is None else valid[jots],
                    plane[r.start : r.stop],
                    threads,
                )
            release(part)
            if progress:
                progress((index + 1) / len(slabs))
        return counts

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write ``path`` (`.npy`, a photon cube) and beside it a small `.json`.

        The `.npy` opens in ``numpy.unpackbits`` and every tool that takes photon cubes; the
        `.json` keeps the true width and the sensor, whose maps stand in `.npy` files of their own.
        """
        from jotlight.formats.cube import write_cube

        write_cube(self, path)

    def __repr__(self) -> str:
        frames, height, width, *channels = self.shape
        colour = f" x {channels[0]} channels" if channels else ""
        plural = "" if frames == 1 else "s"
        sensor = f", {self.sensor!r}" if self.sensor else ""
        return f"<Bits: {frames} frame{plural} of {height} x {width} jots{colour}{sensor}>"


def check_fits(bits: Bits, sensor: "Sensor") -> None:
    """Raise ValueError unless a sensor can have reported these bits."""
    frames, height, width = bits.shape[:3]
    if frames != sensor.frames:
        some = f"bits[:{sensor.frames}] (--frame-range 0:{sensor.frames}), or "
        raise ValueError(
            f"bits: expected the sensor's {sensor.frames} frames, got {frames}; take "
            f"{some if sensor.frames < frames else ''}"
            f"sensor.replace(frames={frames}) (--frames {frames})"
        )
    if height % sensor.oversampling or width % sensor.oversampling:
        raise ValueError(
            f"bits: expected rows and columns of jots that are multiples of the oversampling "
            f"{sensor.oversampling}, got {height} x {width}"
        )
    sensor.check_jots(height, width)
