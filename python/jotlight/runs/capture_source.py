"""A capture of a run, as the processes of the run open it."""

import dataclasses
import functools

from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.opening.locations import file_state
from jotlight.formats.opening.opening import read_capture
from jotlight.runs.records import Record
from jotlight.sensing.bits.bits import Bits

_KEPT = 4
"""Number of captures that a process keeps open."""


@dataclasses.dataclass(frozen=True)
class CaptureSource:
    """A capture, as each process opens it."""

    path: str
    """A path or a URL."""
    options: ReadingOptions = dataclasses.field(default=ReadingOptions(), hash=False)
    """How it is read. Slices have no hash."""
    state: tuple[int, int] = (0, 0)
    """Number of bytes of its files, and their last change in nanoseconds."""

    @classmethod
    def of(cls, path: str, options: ReadingOptions) -> "CaptureSource":
        """Return the source of a capture in its present state.

        Raises
        ------
        OSError
            When there is no such capture.
        """
        return cls(path, options, file_state(path, options.storage_options))

    def open(self) -> Bits:
        """Return the bits. A process keeps the captures that it used last, until they change.

        Raises
        ------
        OSError, ValueError
            When the capture cannot be read, or holds counts.
        """
        return _open(self)

    def describe(self) -> Record:
        """Return the options that say how the capture is read, as values of JSON, unless False.

        The provenance of the capture states its region, which may be written in several ways.
        """
        hidden = ("isolate", "storage_options", "region")
        return {
            name: repr(value) if isinstance(value, slice) else value
            for name, value in self.options.stated().items()
            if value and name not in hidden
        }


@functools.lru_cache(_KEPT)
def _open(source: CaptureSource) -> Bits:
    """Return the bits of a capture. Each state of it is opened by itself."""
    capture = read_capture(source.path, source.options)
    if not isinstance(capture, Bits):
        kind = "counts" if capture.sensor is None else "readings of several bits"
        film = ", or use `jotlight film` for windows of its images" if len(capture) > 1 else ""
        raise ValueError(
            f"{source.path}: expected bits in a run over captures or windows, got {kind}; run this "
            f"capture by itself, as a whole{film}"
        )
    return capture
