"""A part of each frame: some rows and columns of jots, and the sensor that has them."""

import dataclasses
import re
from typing import Any, Self, SupportsIndex, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Packed
from jotlight.checks import shown
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.sensor_like import SensorLike
from jotlight.sensing.parameters.slices import chosen_range, format_frame_range

_REGION_NOTE = re.compile(
    r"rows (\d{1,9}):(\d{1,9}) and columns (\d{1,9}):(\d{1,9}) of (\d{1,9}) x (\d{1,9})", re.ASCII
)
"""What :meth:`Region.describe` returns."""

S = TypeVar("S", bound=SensorLike)

OneFrame = tuple[SupportsIndex, slice] | tuple[SupportsIndex, slice, slice]
"""The index of a part of one frame."""


@dataclasses.dataclass(frozen=True)
class Region:
    """Consecutive rows and columns of jots."""

    rows: range
    columns: range

    @classmethod
    def of(
        cls, name: str, parts: tuple[Any, ...], shape: tuple[int, ...], sensor: SensorLike | None
    ) -> Self | None:
        """Return the region of slices of rows and columns, or None for whole frames.

        Parameters
        ----------
        name : str
            The name of the data in messages.
        parts : tuple
            The slices of rows and of columns. The slice of columns may be missing.
        shape : tuple of int
            The shape of the data, (T, H, W) or (T, H, W, C).
        sensor : SensorLike, optional
            Their sensor, whose pixels must remain whole.

        Raises
        ------
        TypeError, ValueError
            For anything but slices of whole numbers, and for rows or columns that are not
            consecutive, are none, or divide pixels.

        Examples
        --------
        >>> Region.of("bits", (slice(10, 40), slice(-16, None)), (9, 64, 96), None)
        Region(rows=range(10, 40), columns=range(80, 96))
        """
        if len(parts) > 2 or not all(isinstance(part, slice) for part in parts):
            text = ", ".join(
                format_frame_range(p) if isinstance(p, slice) else shown(p) for p in parts
            )
            raise TypeError(
                f"{name}: expected slices of rows and columns after the frames, such as "
                f"{name}[:16, 10:40, 16:48], got {text}; np.asarray({name}) is an array, which "
                "takes all indices of NumPy"
            )
        side = 1 if sensor is None else sensor.oversampling
        rows, columns = (
            _jots(name, title, part, length, side)
            for title, part, length in zip(
                ("rows", "columns"), (*parts, slice(None), slice(None))[:2], shape[1:3], strict=True
            )
        )
        is_whole = (len(rows), len(columns)) == shape[1:3]
        return None if is_whole else cls(rows, columns)

    @property
    def slices(self) -> tuple[slice, slice]:
        """The rows and the columns as slices."""
        return slice(self.rows.start, self.rows.stop), slice(self.columns.start, self.columns.stop)

    def describe(self, shape: tuple[int, ...]) -> str:
        """Return the region of data of some shape, (T, H, W) or (T, H, W, C), in words."""
        rows, columns = map(format_frame_range, self.slices)
        return f"rows {rows} and columns {columns} of {shape[1]} x {shape[2]}"

    def crop_packed(self, packed: Packed | Frames) -> Packed | Frames:
        """Return the region of packed bits, (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C).

        Frames in files are read and cropped when they are needed.

        Examples
        --------
        >>> packed = np.array([[[0b00001111, 0b01000000]]], np.uint8)
        >>> region = Region(range(1), range(5, 10))
        >>> np.unpackbits(region.crop_packed(packed), axis=2, count=5).tolist()
        [[[1, 1, 1, 0, 1]]]
        """
        if isinstance(packed, Frames):
            size = len(self.rows), (len(self.columns) + 7) // 8
            shape = len(packed), *size, *packed.shape[3:]
            # A bound method of a frozen class, so copies in other processes crop, too.
            return packed.derive(
                self.crop_packed, shape, lambda a, b: self._crop(packed.read(a, b))
            )
        return self._crop(packed)

    def _crop(self, packed: Packed) -> Packed:
        first, shift = divmod(self.columns.start, 8)
        rows, width = self.slices[0], len(self.columns)
        part = packed[:, rows, first : (self.columns.stop + 7) // 8]
        if shift:
            shifted = part << np.uint8(shift)
            shifted[:, :, :-1] |= part[:, :, 1:] >> np.uint8(8 - shift)
            part = shifted[:, :, : (width + 7) // 8]
        part = part.copy()
        if width % 8:  # the bits after the last column are 0
            part[:, :, -1] &= np.uint8(0xFF00 >> width % 8 & 0xFF)
        return part

    def crop_sensor(self, sensor: S) -> S:
        """Return the sensor whose maps and mosaic are those of the region."""
        rows, columns = self.slices
        changes: dict[str, Any] = {
            name: map_[rows, columns] for name, map_ in sensor.maps().items()
        }
        if sensor.mosaic is not None:
            side = sensor.oversampling
            pixels = (range(each.start // side, each.stop // side) for each in (rows, columns))
            changes["mosaic"] = sensor.mosaic.crop(*pixels)
        return sensor.replace(**changes) if changes else sensor


def _jots(name: str, title: str, part: slice, length: int, side: int) -> range:
    """Return some of the rows or columns, which are whole pixels of `side` jots."""
    found, text = chosen_range(name, title, part, length), format_frame_range(part)
    if found.step != 1:
        raise ValueError(f"{name}: expected consecutive {title}, such as 10:40, got {text}")
    if len(found) == 0:
        raise ValueError(f"{name}: no {title} in {text} of {length}")
    if found.start % side or found.stop % side:
        first, last = found.start // side * side, -(-found.stop // side) * side
        raise ValueError(
            f"{name}: expected {title} of whole pixels, from and to multiples of {side} jots, got "
            f"{text}; take {first}:{last}"
        )
    return found


def parse_region(text: str) -> tuple[slice, slice]:
    """Return the rows and the columns of R0:R1,C0:C1.

    Raises
    ------
    ValueError
        For another text.

    Examples
    --------
    >>> parse_region("10:40,16:48"), parse_region(":40,:")
    ((slice(10, 40, None), slice(16, 48, None)), (slice(None, 40, None), slice(None, None, None)))
    """
    match = re.fullmatch(r"(\d{0,9}):(\d{0,9}),(\d{0,9}):(\d{0,9})", text.strip(), re.ASCII)
    if match is None:
        raise ValueError(
            "region: expected rows and columns R0:R1,C0:C1 in whole numbers, such as 10:40,16:48, "
            f"got {text!r}"
        )
    ends = [int(number) if number else None for number in match.groups()]
    return slice(*ends[:2]), slice(*ends[2:])


def note_part(
    provenance: Provenance | None, frames: slice, region: Region | None, shape: tuple[int, ...]
) -> Provenance | None:
    """Return the provenance of some frames, or of a region, of data of some shape.

    Examples
    --------
    >>> region = Region(range(8), range(2, 9))
    >>> print(note_part(Provenance("npy", "a.npy"), slice(4), region, (9, 8, 16)))
    a.npy (npy; frames 0:4 of 9; rows 0:8 and columns 2:9 of 8 x 16)
    """
    if provenance is None:
        return None
    start, stop, step = frames.indices(shape[0])
    if len(range(start, stop, step)) < shape[0]:
        taken = format_frame_range(slice(start, stop, None if step == 1 else step))
        provenance = provenance.with_notes(f"frames {taken} of {shape[0]}")
    return provenance if region is None else provenance.with_notes(region.describe(shape))


def noted_region(provenance: Provenance) -> tuple[Region, tuple[int, int]] | None:
    """Return the region that data have according to :func:`note_part`, or None if it is unknown.

    If the data were turned after the region was taken, it is the region of the turned frames.

    Returns
    -------
    region : Region
        Rows and columns of the frames from which the first region was taken.
    size : (int, int)
        The rows and columns of these frames.

    Examples
    --------
    >>> whole = Provenance("npy", "a.npy")
    >>> part = note_part(whole, slice(9), Region(range(8, 40), range(64)), (9, 64, 64))
    >>> noted_region(note_part(part, slice(9), Region(range(2, 6), range(5, 9)), (9, 32, 64)))
    (Region(rows=range(10, 14), columns=range(5, 9)), (64, 64))
    """
    found: tuple[Region, tuple[int, int]] | None = None
    before = (0, False)
    for step in reversed([*provenance.lineage()]):
        if step.orientation is None:
            return None
        # A file is turned before its region is taken.
        if found is not None:
            found = _turned(*found, before, step.orientation)
        before = step.orientation
        for match in filter(None, map(_REGION_NOTE.fullmatch, step.notes)):
            top, bottom, left, right, height, width = map(int, match.groups())
            rows, columns = slice(top, bottom), slice(left, right)
            if found is None:
                found = Region(range(height)[rows], range(width)[columns]), (height, width)
            else:
                outer, size = found
                found = Region(outer.rows[rows], outer.columns[columns]), size
    return found


def _turned(
    region: Region, size: tuple[int, int], before: tuple[int, bool], after: tuple[int, bool]
) -> tuple[Region, tuple[int, int]]:
    """Return the region and the size of frames that are turned from one orientation to another.

    Examples
    --------
    >>> _turned(Region(range(2), range(5)), (8, 9), (0, False), (1, False))
    (Region(rows=range(4, 9), columns=range(0, 2)), (9, 8))
    """
    rows, columns, (height, width) = region.rows, region.columns, size
    if before[1]:
        columns = _mirrored(columns, width)
    for _ in range((after[0] - before[0]) % 4):
        rows, columns = _mirrored(columns, width), rows
        height, width = width, height
    if after[1]:
        columns = _mirrored(columns, width)
    return Region(rows, columns), (height, width)


def _mirrored(part: range, length: int) -> range:
    return range(length - part.stop, length - part.start)


def split_index(index: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the index of frames, and the slices of rows and columns, which may be none.

    Examples
    --------
    >>> split_index(3), split_index((slice(2), slice(1, 4)))
    ((3, ()), (slice(None, 2, None), (slice(1, 4, None),)))
    """
    return (index[0], index[1:]) if isinstance(index, tuple) and index else (index, ())


def crop_frames(frames: npt.NDArray[Any] | Frames, region: Region) -> npt.NDArray[Any] | Frames:
    """Return the region of unpacked frames, (T, H, W) or (T, H, W, C). Files are read later."""
    key: Any = ..., *region.slices, *(slice(None),) * (frames.ndim - 3)
    part: npt.NDArray[Any] | Frames = frames[key]
    return part
