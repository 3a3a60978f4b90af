"""What a file format consists of: its name, how it is detected, read, and written."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

from jotlight.checks import Counts
from jotlight.formats.capture import Capture
from jotlight.sensing.bits import Bits


@dataclasses.dataclass(frozen=True)
class OpenOptions:
    """How the caller of :func:`jotlight.open` wants stored arrays to be interpreted."""

    key: str | None = None
    """Name of the array in a file that holds several."""
    counts: bool | None = None
    """Whether the numbers are counts (True) or packed bits (False). None: decide by their type."""
    width: int | None = None
    """True width in jots."""
    packed: bool = False
    """Whether the caller asserts that a byte holds eight bits, which skips :func:`check_packed`."""


@dataclasses.dataclass(frozen=True)
class Writer:
    """How captures are written in a format.

    Each function writes the whole file or folder, or nothing: it uses
    :func:`jotlight.files.atomic_write` or :func:`jotlight.files.atomic_folder`.
    """

    bits: Callable[[Bits, Path], None] | None = None
    """Write packed bits to a path. None: the format has no bits, and counts are written instead."""
    counts: Callable[[Counts, Path, str | None], None] | None = None
    """Write an image of counts and its JSON label to a path. None: the format has no counts."""
    extensions: tuple[str, ...] = ()
    """Extensions of a file, the preferred one first. Empty: the format is always a folder."""
    folder: bool = False
    """Whether a path without extension becomes a new folder in this format."""
    keeps_sensor: bool = False
    """Whether bits keep their true width, sensor, and provenance."""
    keeps_label: bool = False
    """Whether counts keep their label: the number of trials, and the provenance."""


@dataclasses.dataclass(frozen=True)
class Format:
    """A file format, as one entry of :data:`jotlight.formats.registry.FORMATS`."""

    name: str
    """Name that ``jotlight.open(..., format=)`` and ``--format`` accept."""
    summary: str
    """Description in a few words."""
    open: Callable[[Path, OpenOptions], Capture]
    """Return the capture at a path; raise ValueError if the content is invalid."""
    matches: Callable[[Path], bool] | None = None
    """Whether the content at an existing path is in this format. None: the content cannot tell."""
    extensions: tuple[str, ...] = ()
    """Extensions that promise this format. A file without the expected content is refused."""
    has_keys: bool = False
    """Whether a file holds several arrays, from which `key` selects one."""
    is_raw: bool = False
    """Whether files have no header, so that the caller has to name the format."""
    fixed_layout: bool = False
    """Whether the format defines how bits are stored, so that `unpacked` does not apply."""
    writer: Writer | None = None
    """How the format is written. None: it is read only."""
