"""The definition of a file format: its name, its detection, its reader, and its writer."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts, Packed
from jotlight.formats.capture import Capture
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings


@dataclasses.dataclass(frozen=True)
class Writer:
    """The functions that write captures in a format, and what they store.

    Each function writes the whole file or folder, or nothing: it uses
    :func:`jotlight.files.atomic_write` or :func:`jotlight.files.atomic_folder`.
    """

    bits: Callable[[Bits, Path], None] | None = None
    """A function that writes packed bits. None: the format stores only counts, the sums of bits."""
    counts: Callable[[Counts, Path, str], None] | None = None
    """A function that writes counts and their JSON label. None: the format stores only bits."""
    readings: Callable[[Readings, Path], None] | None = None
    """A function that writes readings of several bits with their sensor. None: the format has no
    place for them."""
    extensions: tuple[str, ...] = ()
    """Extensions of a file, the preferred one first. Empty: the format is always a folder."""
    plain: bool = False
    """Whether bits are stored without compression, so that their size is known beforehand."""
    folder: bool = False
    """Whether a path without extension becomes a new folder in this format."""
    keeps_sensor: bool = False
    """Whether bits keep their true width, sensor, and provenance."""
    keeps_label: bool = False
    """Whether counts keep their label: the number of trials, and the provenance."""


@dataclasses.dataclass(frozen=True)
class FrameLayout:
    """The layout of raw frames that follow each other in a file."""

    shape: tuple[int, int]
    """(H, ceil(W / 8)): the shape of a packed frame; (H, W) for numbers."""
    width: int
    """W."""
    frame_bytes: int
    """Number of bytes of a raw frame."""
    decode: Callable[[Packed], npt.NDArray[Any]]
    """A function that returns packed frames (n, H, ceil(W / 8)), or numbers (n, H, W), for the raw
    bytes (n, frame_bytes)."""
    file_header: int = 0
    """Number of bytes before the first frame of a file."""
    dtype: npt.DTypeLike = np.uint8
    """The type of packed frames or of numbers."""


@dataclasses.dataclass(frozen=True)
class Format:
    """A file format, as one entry of :data:`jotlight.formats.registry.FORMATS`."""

    name: str
    """Name that ``jotlight.open(..., format=)`` and ``--format`` accept."""
    summary: str
    """Description in a few words."""
    open: Callable[[Path, ReadingOptions], Capture]
    """A function that returns the capture at a path, or raises ValueError for invalid content.

    It selects no frames or region of the capture, and does not rotate it."""
    matches: Callable[[Path], bool] | None = None
    """A function that detects this format at a path. None: the content does not show the format."""
    extensions: tuple[str, ...] = ()
    """Extensions of this format. A file with such a name but other content is refused."""
    other_extensions: tuple[str, ...] = ()
    """Other extensions that such files often have, for programs that select files by name."""
    has_keys: bool = False
    """Whether a file holds several arrays, from which `key` selects one."""
    is_raw: bool = False
    """Whether files have no header, so that the caller usually has to name the format."""
    layout: FrameLayout | None = None
    """The layout of raw frames, for files that are read while a camera writes them."""
    fixed_layout: bool = False
    """Whether the format defines how bits are stored, so that `unpacked` does not apply."""
    verify: Callable[[Path], int] | None = None
    """A function that checks the checksums that lie outside of the data, which reading the data
    does not check. It returns the number of files that have one, and raises ValueError if one
    differs. None: the format has no such checksums."""
    writer: Writer | None = None
    """The functions that write this format. None: jotlight can only read it."""
