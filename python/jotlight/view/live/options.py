"""Opening of a live capture: what it is, and the layout of its frames."""

import dataclasses
import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jotlight.calibration import Calibration
from jotlight.calibration.stated_sensor import stated_sensor
from jotlight.formats.capture import assumed_sensor_note
from jotlight.formats.format import FrameLayout
from jotlight.formats.frames.raw_layout import MAX_FRAME_BYTES, RawLayout
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.opening.locations import STANDARD_INPUT
from jotlight.formats.reading import open_capture
from jotlight.formats.registry import FORMATS
from jotlight.formats.stated_layout import bits_layout
from jotlight.parameter_names import check_choice
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.reading_groups import frames_differ
from jotlight.sensing.sensor import Sensor
from jotlight.view.live.capture import LiveCapture, read_stream
from jotlight.view.live.folder import FolderReader, open_first
from jotlight.view.live.ring import FrameRing
from jotlight.view.live.tails import POLL_SECONDS, FileTail, PipeTail

_MAX_HISTORY = 1 << 16
"""Maximum memory for frames in MiB."""

_NPY_MAGIC = b"\x93NUMPY"
"""First bytes of a .npy."""

_MAX_HEADER = 1 << 12
"""Maximum size of the header of a .npy."""

_Opened = tuple[FrameRing, Callable[[LiveCapture], None], str, Sensor | None]
"""The frames, the work that adds later ones, the name of the format, and the sensor of one frame if
the files state it."""


@dataclasses.dataclass(frozen=True)
class LiveOptions:
    """How to read a live capture."""

    format: str | None = None
    """Name of a raw format."""
    layout: str | None = None
    """Layout of raw frames without a format, as the text of a :class:`jotlight.RawLayout`."""
    history: int = 256
    """Memory for frames in MiB."""
    arguments: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Keyword arguments of :func:`jotlight.open` for the files of a folder. The width is also that
    of a .npy, and `unpacked` is also for raw frames of numbers."""

    def frame_layout(self) -> tuple[FrameLayout, str] | None:
        """Return the layout of raw frames and its name, or None if files have headers.

        Examples
        --------
        >>> layout, name = LiveOptions(layout="256x500").frame_layout()
        >>> layout.shape, layout.width, name
        ((256, 63), 500, 'raw')
        """
        if not 1 <= self.history <= _MAX_HISTORY:
            raise ValueError(f"history: expected 1 to {_MAX_HISTORY} MiB, got {self.history}")
        unpacked = self.arguments.get("unpacked")
        options = ReadingOptions(format=self.format, layout=self.layout, unpacked=unpacked)
        if options.layout is not None:
            layout = RawLayout.parse(options.layout)
            if layout.number_type is not None and not unpacked:
                raise ValueError(
                    f"layout: expected bits for --follow, got numbers of {layout.dtype}; "
                    "--unpacked reads 0 and 1, or 0 and 255, as bits"
                )
            return bits_layout(layout), "raw"
        if self.format is None:
            return None
        check_choice("format", self.format, FORMATS)
        of_format = FORMATS[self.format].layout
        return None if of_format is None else (of_format, self.format)


def _packed_layout(height: int, width: int) -> FrameLayout:
    """Return the layout of frames that are packed already, as in a .npy."""
    return bits_layout(RawLayout(height, width))


def open_live(
    path: Path,
    options: LiveOptions,
    sensor_kwargs: dict[str, Any],
    calibration: Calibration | None = None,
    *,
    is_range_known: bool = False,
) -> LiveCapture:
    """Return a capture that grows, after its first frame has arrived.

    Parameters
    ----------
    path : Path
        A file, a folder, or ``-`` for standard input.
    options : LiveOptions
        The layout of the frames.
    sensor_kwargs : dict
        Keyword arguments of the sensor of one frame, which replace those that files state.
    calibration : Calibration, optional
        Calibration of the sensor.
    is_range_known : bool
        Whether the user states the largest intensity.

    Raises
    ------
    OSError, ValueError
        When the capture cannot be read, or the layout of its frames is unknown.
    """
    options.frame_layout()  # reports wrong options
    stop = threading.Event()
    if path != STANDARD_INPUT and path.is_dir():
        ring, work, name, stated = _open_folder(path, options)
    else:
        ring, work, name, stated = _open_stream(path, options, stop)
    jots = ring.layout.shape[0], ring.layout.width
    sensor = stated_sensor(stated, calibration, sensor_kwargs, frames=1, jots=jots, provenance=None)
    sensor.check_map_shapes(*jots)
    is_range_known = is_range_known or stated is not None
    note = assumed_sensor_note(sensor) if stated is None else ""
    title = "standard input" if path == STANDARD_INPUT else path.name
    provenance = Provenance(name, title, ("followed while it grows",))
    live = LiveCapture(
        title, ring, sensor, provenance, is_range_known=is_range_known, sensor_note=note
    )
    live.stop = stop
    live.start(work)
    return _wait_for_frame(live)


def _open_stream(path: Path, options: LiveOptions, stop: threading.Event) -> _Opened:
    """Return the frames of a file or of standard input, and the work that adds later ones."""
    tail: FileTail | PipeTail
    if path != STANDARD_INPUT:
        if path.is_fifo():
            raise ValueError(
                f"{path}: expected a file or a folder, got a pipe; redirect it to standard input: "
                f"jotlight view - --follow < {path}"
            )
        tail = FileTail(path, stop)
    elif sys.stdin is None or sys.stdin.isatty():
        raise ValueError(
            "standard input: expected the frames of a program, such as: "
            "camera | jotlight view - --follow --layout 256x512"
        )
    else:
        tail = PipeTail(sys.stdin.fileno())
    try:
        frames, name = _read_layout(tail, path, options)
        first = tail.skip(options.history << 20, frames.frame_bytes)
        ring = FrameRing(frames, options.history << 20, first)
    except BaseException:  # such as a file that is gone, too little memory, or Ctrl-C
        tail.close()
        raise
    return ring, partial(read_stream, tail=tail), name, None


def _open_folder(path: Path, options: LiveOptions) -> _Opened:
    """Return the memory for the frames of a folder, and the work that adds them."""
    arguments = {"format": options.format, "layout": options.layout, **options.arguments}

    def open_file(file: Path) -> Any:
        return open_capture(file, **arguments)

    file, bits, seen = open_first(path, open_file)
    layout = _packed_layout(bits.packed.shape[1], bits.width)
    ring = FrameRing(layout, options.history << 20)
    name = bits.provenance.format if bits.provenance else "folder"
    is_raw = name in FORMATS and FORMATS[name].is_raw
    work = FolderReader(path, open_file, file, seen, is_raw=is_raw)
    return ring, work, name, _frame_sensor(bits, file)


def _frame_sensor(bits: Bits, file: Path) -> Sensor | None:
    """Return the sensor of one frame, or None if the bits state none."""
    sensor = carried_sensor(bits)
    if sensor is None:
        return None
    if frames_differ(sensor) or sensor.read_noise:
        raise ValueError(
            f"{file}: expected single bits of one exposure and one threshold, without read noise, "
            f"for a live view, got those of {sensor!r}; view the file without --follow"
        )
    return sensor.replace(frames=1)


def _wait_for_frame(live: LiveCapture) -> LiveCapture:
    while True:
        has_ended = live.ended  # before the frames, of which the last ones may arrive meanwhile
        if live.frames:
            return live
        if has_ended:
            raise ValueError(live.problem or f"{live.title}: ended before its first frame")
        live.stop.wait(POLL_SECONDS)


def _read_layout(
    tail: FileTail | PipeTail, path: Path, options: LiveOptions
) -> tuple[FrameLayout, str]:
    """Return the layout of frames and its name. The frames are what is read next.

    Raises
    ------
    ValueError
        When neither the options nor the bytes state a layout, or both do.
    """
    layout = options.frame_layout()
    start = _read_bytes(tail, len(_NPY_MAGIC))
    is_npy = start == _NPY_MAGIC
    usable = {"width"} if is_npy else {"unpacked"} if options.layout is not None else set()
    for name in [each for each in options.arguments if each not in usable]:
        other = {"width": "a .npy or ", "unpacked": "a --layout of numbers or "}.get(name, "")
        raise ValueError(
            f"follow: --{name} is for {other}a folder of files; for raw frames, use --layout or "
            "--format"
        )
    if layout is None:
        if options.format not in (None, "npy"):
            followed = [name for name, each in FORMATS.items() if each.layout is not None]
            raise ValueError(
                f"format: expected {', '.join(followed)}, or npy, since --follow reads no other "
                f"files that grow, got {options.format}"
            )
        return _read_npy_header(tail, path, start, options.arguments.get("width")), "npy"
    if is_npy:
        stated = "format" if options.layout is None else "layout"
        raise ValueError(
            f"{stated}: {_name(path)} is a .npy, whose header states the rows and columns; leave "
            f"out --{stated}, or state a width that is no multiple of 8 by --width"
        )
    tail.unread(start)
    frames, _ = layout
    _read_bytes(tail, frames.file_header)
    return layout


def _name(path: Path) -> str:
    return "standard input" if path == STANDARD_INPUT else str(path)


def _read_npy_header(
    tail: FileTail | PipeTail, path: Path, start: bytes, width: int | None
) -> FrameLayout:
    """Return the layout of the frames of a .npy, whose first bytes have been read.

    Raises
    ------
    ValueError
        When the bytes are no .npy of packed bits, or its rows do not have this width.
    """
    expected = (
        f"{_name(path)}: expected raw frames, whose layout --format or --layout states, or a .npy "
        "with packed bits (T, H, W / 8) of uint8"
    )
    if start != _NPY_MAGIC:
        raise ValueError(expected)
    version = _read_bytes(tail, 2)
    if version[:1] not in (b"\1", b"\2"):
        raise ValueError(expected)
    size = int.from_bytes(_read_bytes(tail, 2 if version[0] == 1 else 4), "little")
    if size > _MAX_HEADER:
        raise ValueError(expected)
    from ast import literal_eval

    try:
        header = literal_eval(_read_bytes(tail, size).decode("latin-1"))
        shape, kind = header["shape"], np.dtype(header["descr"])
        is_cube = kind == np.uint8 and len(shape) == 3 and not header["fortran_order"]
        height, row_bytes = int(shape[1]), int(shape[2])
    except (ValueError, SyntaxError, LookupError, TypeError, MemoryError, RecursionError) as error:
        raise ValueError(expected) from error
    if not is_cube or not 0 < height * row_bytes <= MAX_FRAME_BYTES:
        raise ValueError(expected)
    widths = range(8 * row_bytes - 7, 8 * row_bytes + 1)
    if width is not None and width not in widths:
        raise ValueError(
            f"width: expected {widths[0]} to {widths[-1]}, since a row of {_name(path)} has "
            f"{row_bytes} bytes, got {width}"
        )
    return _packed_layout(height, width or widths[-1])


def _read_bytes(tail: FileTail | PipeTail, size: int) -> bytes:
    """Return some bytes, and wait for them. There are fewer only if no more will arrive."""
    data = bytearray(size)
    filled = 0
    while filled < size:
        try:
            filled += tail.read(memoryview(data)[filled:])
        except EOFError:
            break
    return bytes(data[:filled])
