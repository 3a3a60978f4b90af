"""A capture of a run, as the processes of the run open it."""

import dataclasses
import functools
from typing import Any

from jotlight.dask.records import Record
from jotlight.formats.locations import file_state
from jotlight.formats.reading import open_capture
from jotlight.sensing.bits import Bits
from jotlight.sensing.crop import parse_region

_KEPT = 4
"""Number of captures that a process keeps open."""


@dataclasses.dataclass(frozen=True)
class CaptureSource:
    """A capture, as each process opens it."""

    path: str
    """A path or a URL."""
    options: tuple[tuple[str, Any], ...] = ()
    """Options of :func:`jotlight.formats.open_capture`, and "region", the text of a region."""
    state: tuple[int, int] = (0, 0)
    """Number of bytes of its files, and their last change in nanoseconds."""

    @classmethod
    def of(cls, path: str, options: dict[str, Any]) -> "CaptureSource":
        """Return the source of a capture in its present state.

        Raises
        ------
        OSError
            When there is no such capture.
        """
        state = file_state(path, options.get("storage_options"))
        return cls(path, tuple(options.items()), state)

    def open(self) -> Bits:
        """Return the bits. A process keeps the captures that it used last, until they change.

        Raises
        ------
        OSError, ValueError
            When the capture cannot be read, or holds counts.
        """
        return _open(self.path, _HashableOptions(self.options), self.state)

    def describe(self) -> Record:
        """Return the options that say how the capture is read, as values of JSON.

        The provenance of the capture states its region, which may be written in several ways.
        """
        hidden = ("isolate", "means", "storage_options", "region")
        return {
            name: repr(value) if isinstance(value, slice) else value
            for name, value in self.options
            if value not in (None, 0) and name not in hidden
        }


class _HashableOptions(dict[str, Any]):
    """Options that are equal if their texts are, because slices cannot be hashed."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(repr(self))


@functools.lru_cache(_KEPT)
def _open(path: str, options: _HashableOptions, _state: tuple[int, int]) -> Bits:
    """Return the bits of a capture. Each state of it is opened by itself."""
    region = options.get("region")
    capture = open_capture(path, **{k: v for k, v in options.items() if k != "region"})
    if not isinstance(capture, Bits):
        kind = "counts" if capture.sensor is None else "readings of several bits"
        film = ", or use `jotlight film` for windows of its images" if len(capture) > 1 else ""
        raise ValueError(
            f"{path}: expected bits in a run over captures or windows, got {kind}; run this "
            f"capture by itself, as a whole{film}"
        )
    return capture if region is None else capture[:, *parse_region(region)]
