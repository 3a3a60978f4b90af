"""The data: bits in packed form, and what a pixel's bits amount to."""

import dataclasses
import os
from collections.abc import Callable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight import _engine
from jotlight.sensor import Sensor
from jotlight.slabs import slabs_of


class Bits:
    """Bits of a single-photon camera, eight to a byte.

    Parameters
    ----------
    packed : ndarray of uint8, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
        The layout of ``numpy.packbits`` along the width, most significant bit first, as photon
        cubes have it. May be a memory map; it is never unpacked whole.
    width : int, optional
        The true width W in jots. Default: ``8 * packed.shape[2]``.
    sensor : Sensor, optional
        What made the bits, where it is known.

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
        packed: npt.NDArray[np.uint8],
        width: int | None = None,
        sensor: Sensor | None = None,
    ) -> None:
        if not isinstance(packed, np.ndarray) or packed.dtype != np.uint8:
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
        self.width = full if width is None else int(width)
        self.sensor = sensor
        if not full - 8 < self.width <= full:
            raise ValueError(
                f"width: expected {full - 7} to {full} for {packed.shape[2]} bytes a row, "
                f"got {width}"
            )
        if sensor is not None:
            _check_fits(self, sensor)

    @classmethod
    def from_array(cls, array: npt.ArrayLike, sensor: Sensor | None = None) -> Self:
        """Pack an array of bool, or of 0 and 1, of shape (T, H, W), (H, W) or (T, H, W, C).

        Examples
        --------
        >>> Bits.from_array(np.eye(10, dtype=bool)).packed.shape
        (1, 10, 2)
        """
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
            raise ValueError(f"bits: no frames in {frames!r} of {len(self)}")
        sensor = self.sensor and self.sensor.replace(frames=len(packed))
        return type(self)(packed, self.width, sensor)

    def to_array(self) -> npt.NDArray[np.bool_]:
        """Unpack into bool, (T, H, W) or (T, H, W, C): eight times the memory."""
        return np.unpackbits(self.packed, axis=2, count=self.width).view(np.bool_)

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
        slabs = list(slabs_of(frames, counts.shape[0], width * oversampling))
        planes: list[tuple[Any, Any]] = [(self.packed, counts)]
        if channels:
            planes = [(self.packed[..., c], counts[..., c]) for c in range(channels[0])]
        for step, (packed, plane) in enumerate(planes):
            for index, (f, r) in enumerate(slabs):
                jots = slice(r.start * oversampling, r.stop * oversampling)
                _engine.add_block_counts(
                    packed[f.start : f.stop, jots],
                    width,
                    oversampling,
                    None if valid is None else valid[jots],
                    plane[r.start : r.stop],
                    threads,
                )
                if progress:
                    progress((step + (index + 1) / len(slabs)) / len(planes))
        return counts

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write ``path`` (`.npy`, a photon cube) and beside it a small `.json`.

        The `.npy` opens in ``numpy.unpackbits`` and every tool that takes photon cubes; the
        `.json` keeps the true width and the sensor, whose maps stand in `.npy` files of their own.
        """
        from jotlight.formats.npy import save_bits

        save_bits(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, width: int | None = None) -> "Bits":
        """Open a `.npy` photon cube, ours or anyone's, as a memory map.

        Parameters
        ----------
        path : path
            The `.npy` file. A `.json` of the same name beside it is read too, where there is one.
        width : int, optional
            The true width in jots, where no `.json` tells.
        """
        from jotlight.formats.npy import load_bits

        return load_bits(path, width=width)

    def __repr__(self) -> str:
        frames, height, width, *channels = self.shape
        colour = f" x {channels[0]} colours" if channels else ""
        plural = "" if frames == 1 else "s"
        sensor = f", {self.sensor!r}" if self.sensor else ""
        return f"<Bits: {frames} frame{plural} of {height} x {width} jots{colour}{sensor}>"


@dataclasses.dataclass(frozen=True)
class Observation:
    """What a sensor saw of every pixel, where the pixel's bits are exchangeable (box kernel)."""

    sensor: Sensor
    counts: npt.NDArray[np.int32]
    """L, (H, W)."""
    trials: int | npt.NDArray[np.int32]
    """Valid bits of each pixel: K, or a map where jots are dead."""
    dark_counts: float | npt.NDArray[np.float64]
    """d of each pixel's jots: a number or a map (H, W), the mean where a pixel's jots differ."""
    dark_varies: bool
    """Whether the jots inside of some pixel differ in their dark counts."""

    @property
    def blind(self) -> npt.NDArray[np.bool_] | None:
        """Pixels without a valid bit, if there are any."""
        if isinstance(self.trials, int) or self.trials.all():
            return None
        return np.asarray(self.trials == 0)


def observe(data: "Bits | npt.ArrayLike", sensor: Sensor, threads: int | None) -> Observation:
    """Count the valid ones of each pixel, from bits or from an image of counts of one channel."""
    if isinstance(data, Bits):
        _check_fits(data, sensor)
        _, height, width = data.shape
        counts = data.counts(sensor.oversampling, mask=sensor.mask, threads=threads)
    else:
        counts = as_counts(data)
        height, width = (size * sensor.oversampling for size in counts.shape)
        sensor.check_jots(height, width)
        if sensor.oversampling > 1 and sensor.mask is not None:
            raise ValueError(
                "counts: with a mask of single jots the bits are needed, since a count does not "
                "tell which jots fired; give the bits, or a sensor without mask"
            )
    trials: int | npt.NDArray[np.int32] = sensor.bits_per_pixel
    if sensor.mask is not None:
        valid = Bits.from_array(~sensor.mask).counts(sensor.oversampling)
        trials = valid * np.int32(sensor.frames)
        if not isinstance(data, Bits):
            counts = np.where(sensor.mask, np.int32(0), counts)
    most = counts.max()
    if most > sensor.bits_per_pixel or counts.min() < 0:
        raise ValueError(
            f"counts: expected 0 to K = {sensor.bits_per_pixel} ones per pixel "
            f"({sensor.frames} frames of {sensor.oversampling} x {sensor.oversampling} jots), "
            f"got {counts.min()} to {most}"
        )
    dark, varies = _pixel_dark_counts(sensor)
    return Observation(sensor, counts, trials, dark, varies)


def as_counts(data: npt.ArrayLike) -> npt.NDArray[np.int32]:
    """Check an image of counts, (H, W) or (H, W, C)."""
    counts = np.asarray(data)
    if counts.dtype.kind not in "iu":
        raise TypeError(
            f"data: expected jotlight.Bits or an image of counts in whole numbers, got "
            f"{counts.dtype}; Bits.from_array takes bool, and rounded floats can be cast by "
            "astype(int)"
        )
    if counts.ndim not in (2, 3) or counts.size == 0 or (counts.ndim == 3 and counts.shape[2] > 4):
        raise ValueError(
            f"counts: expected shape (H, W) or (H, W, C) with at most 4 channels, got "
            f"{counts.shape}; Bits.from_array takes the single frames (T, H, W) of 0 and 1"
        )
    if counts.min() < 0 or counts.max() >= 2**31:
        raise ValueError(f"counts: expected 0 to 2**31 - 1, got {counts.min()} to {counts.max()}")
    return np.require(counts, np.int32, ["C", "ALIGNED"])


def _pixel_dark_counts(sensor: Sensor) -> tuple[float | npt.NDArray[np.float64], bool]:
    if not isinstance(sensor.dark_counts, np.ndarray):
        return sensor.dark_counts, False
    side = sensor.oversampling
    height, width = (size // side for size in sensor.dark_counts.shape)
    blocks = sensor.dark_counts.astype(np.float64).reshape(height, side, width, side)
    valid = np.ones(blocks.shape, bool)
    if sensor.mask is not None:
        valid = ~sensor.mask.reshape(blocks.shape)
    number = np.maximum(valid.sum(axis=(1, 3)), 1)
    mean = np.where(valid, blocks, 0).sum(axis=(1, 3)) / number
    differs = valid & (blocks != mean[:, None, :, None].astype(np.float32))
    return np.ascontiguousarray(mean), bool(differs.any())


def _check_fits(bits: Bits, sensor: Sensor) -> None:
    frames, height, width = bits.shape[:3]
    if frames != sensor.frames:
        raise ValueError(
            f"bits: expected the sensor's {sensor.frames} frames, got {frames}; "
            f"take bits[:{sensor.frames}], or sensor.replace(frames={frames})"
        )
    if height % sensor.oversampling or width % sensor.oversampling:
        raise ValueError(
            f"bits: expected rows and columns of jots that are multiples of the oversampling "
            f"{sensor.oversampling}, got {height} x {width}"
        )
    sensor.check_jots(height, width)
