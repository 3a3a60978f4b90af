"""Counts in TIFF or grayscale PNG files, or in folders of them, and masks of dead jots."""

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.formats.capture import Capture
from jotlight.formats.files.checksums import check_appended, check_opened, missing_error
from jotlight.formats.files.file_lists import list_files
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.file_sequence import describe_files, join_files
from jotlight.formats.files.limits import check_claimed_size
from jotlight.formats.files.magic import has_type
from jotlight.formats.files.remote_files import open_binary, raise_failure, remote_file
from jotlight.formats.files.safe_paths import MAX_SEARCHED, list_below
from jotlight.formats.format import Format, Writer
from jotlight.formats.frames.count_stacks import as_count_stack
from jotlight.formats.frames.labels import COUNTS, READINGS, parse_label
from jotlight.formats.frames.packing import pack_lazily
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.images.kept_directories import TiffSource
from jotlight.formats.images.png_chunks import (
    GRAYSCALE,
    HEADER_BYTES,
    PALETTE,
    PngHeader,
    check_png,
    read_png_header,
)
from jotlight.formats.images.png_notes import read_png_note
from jotlight.formats.images.tiff_directories import (
    move_samples_last,
    open_checked_tiff,
    shape_of,
)
from jotlight.formats.images.tiff_layout import no_counts_error, note_about_axes
from jotlight.formats.images.tiff_segments import check_segments
from jotlight.formats.images.writing import write_png, write_tiff, write_tiff_readings
from jotlight.layout import is_single_image
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import warn_about_axes
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.provenance import Provenance

_TIFF_EXTENSIONS = (".tif", ".tiff")
_PNG_EXTENSIONS = (".png",)
_RAW_EXTENSION = ".bin"

_PILLOW_SCALE = {2: 85, 4: 17}
"""Factor by which Pillow scales gray levels to 8 bits, for each depth in bits."""


def open_tiff(path: Path, options: ReadingOptions) -> Capture:
    """Return the counts in a TIFF file, or in a folder of them in natural order."""
    return _open_images(path, _TIFF_EXTENSIONS, TIFF.name, read_tiff, options.takes_floats)


def open_png(path: Path, options: ReadingOptions) -> Capture:
    """Return the counts in a grayscale PNG, or in a folder of them in natural order.

    A PNG with a depth of 1 bit is a frame of bits. The levels of files in a folder are decoded when
    they are read. Estimates that jotlight wrote are refused unless the caller asks for counts.
    """
    from_header = path.is_dir()

    def read(file: Path) -> tuple[Frames, None, None]:
        if not options.takes_counts:
            _refuse_estimate(file)
        return read_png(file, from_header=from_header)

    return _open_images(path, _PNG_EXTENSIONS, PNG.name, read)


def _refuse_estimate(path: Path) -> None:
    """Raise ValueError if the note of a PNG says that jotlight computed or drew it."""
    note = read_png_note(path)
    made = note["jotlight"].get("run") if isinstance(note.get("jotlight"), dict) else note
    if not isinstance(made, dict) or not {"method", "sensor"} <= made.keys():
        return
    if "photographs" in made:
        raise ValueError(
            f"{path}: expected counts, got a figure, in which jotlight compares estimates of "
            f"{made['photographs']}; name a capture"
        )
    raise ValueError(
        f"{path}: expected counts, got an estimate for display, which jotlight made of "
        f"{made.get('capture', 'a capture')} by {made['method']}; name the capture itself, or "
        "pass counts=True (--counts) to read the gray levels as counts"
    )


def _matches(path: Path, name: str, extensions: tuple[str, ...]) -> bool:
    """Return whether a file has the signature, or a folder has such files but no raw frames."""
    if not path.is_dir():
        return has_type(path, name)
    has_images = any(file.suffix.lower() in extensions for file in path.iterdir())
    if not has_images:
        return False
    files = list_below(path, (*extensions, _RAW_EXTENSION), max_others=MAX_SEARCHED)
    return not any(file.suffix.lower() == _RAW_EXTENSION for file in files)


def _open_images(
    path: Path,
    extensions: tuple[str, ...],
    name: str,
    read: Callable[[Path], tuple[Frames, str | None, str | None]],
    floats: bool = False,
) -> Capture:
    files = list_files(path, extensions, name.upper())
    parts, labels, notes = zip(*map(read, files), strict=True)
    kinds = {(part.shape[1:], part.dtype): file for part, file in zip(parts, files, strict=True)}
    if len(kinds) != 1:
        each = [
            f"{dtype} of shape {shape} in {file.relative_to(path).as_posix()}"
            for (shape, dtype), file in kinds.items()
        ]
        raise ValueError(
            f"{path}: expected images of one size and type, got {each[0]}, and {each[1]}; move "
            "others to another folder"
        )
    provenance = Provenance(name, path.name)
    if len(files) > 1:
        provenance = provenance.with_notes(describe_files(path, files))
    if notes[0] is not None:
        provenance = provenance.with_notes(notes[0])
    frames = join_files(path, files, parts)
    if frames.dtype == np.bool_ and frames.ndim == 3:
        provenance = provenance.with_notes("black-and-white images are frames of bits, white for 1")
        return Bits(pack_lazily(frames, path.name), frames.shape[2], provenance=provenance)
    label = labels[0] if len(files) == 1 else None
    return as_count_stack(frames, provenance, label, floats=floats, is_stack=True)


def read_tiff(path: Path) -> tuple[Frames, str | None, str | None]:
    """Return the images of a TIFF file, (T, H, W) or (T, H, W, C), its description, and a note."""
    file = FileReader(path)
    verified = check_opened(path)
    try:
        with open_checked_tiff(path) as tiff:
            series = tiff.series[0]
            shape, axes, dtype = shape_of(series), series.axes, series.dtype
            description = tiff.pages[0].description
            is_own = any(parse_label(description, kind) for kind in (COUNTS, READINGS))
            refusal = None if is_own else no_counts_error(tiff, path)
            note = None if is_own else note_about_axes(tiff)
            # Other programs may store channels as pages. Ours are samples.
            single = axes in ("YX", "YXS", "SYX") or (not is_own and is_single_image(shape))
            paged = not single and len(series.pages) == shape[0]
            size = series.size * dtype.itemsize
            frame_bytes = size // shape[0] if paged else size
            check_claimed_size("the header", size, file.size, frame_bytes=frame_bytes)
    except Exception as error:  # tifffile may raise any exception for a damaged file
        raise_failure([path])
        raise ValueError(f"{path}: the TIFF file cannot be read ({error})") from error
    if not verified and is_own:
        raise missing_error(path)
    if refusal is not None:
        raise refusal
    if len(shape) not in (2, 3, 4) or dtype.kind not in "biuf":
        raise ValueError(
            f"{path}: expected counts, (H, W) or (T, H, W), got {dtype} of shape {shape}"
        )
    stack_shape = (1, *shape) if single else shape
    if not is_own:
        warn_about_axes(path.name, stack_shape)
    source = TiffSource(path)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        with file.expect_unchanged():
            try:
                with source.open() as tiff:
                    series = tiff.series[0]
                    if paged:
                        return move_samples_last(_read_pages(tiff, start, stop), axes)
                    for part in filter(None, series.pages):
                        check_segments(tiff, part)
                    images = move_samples_last(series.asarray(), axes)
                    return np.asarray(images.reshape(stack_shape)[start:stop])
            except Exception as error:
                raise_failure([path])
                raise ValueError(f"{path}: the TIFF file is damaged ({error})") from error

    return Frames(stack_shape, read, dtype.newbyteorder("=")), description, note


def _read_pages(tiff: Any, start: int, stop: int) -> npt.NDArray[Any]:
    """Return pages of an open TIFF file as one array."""
    series = tiff.series[0]
    images = np.empty((stop - start, *series.shape[1:]), series.dtype)
    for index in range(start, stop):
        page = series.pages[index]
        _check_page(page, series.shape[1:], tiff.filehandle.size)
        check_segments(tiff, page)
        images[index - start] = page.asarray()
    return images


def _verify_tiff(path: Path) -> int:
    """Return how many TIFF files end with their checksum. Raise ValueError if one differs."""
    return sum(map(check_appended, list_files(path, _TIFF_EXTENSIONS, "TIFF")))


def _check_page(page: Any, shape: tuple[int, ...], file_bytes: int) -> None:
    """Raise ValueError if a page has another shape than its series, or a tile is too large."""
    if math.prod(page.shape) != math.prod(shape):
        raise ValueError(f"expected pages of shape {shape}, got {page.shape}")
    keyframe = page.keyframe
    tile_values = keyframe.tilewidth * keyframe.tilelength * max(1, keyframe.tiledepth)
    check_claimed_size("a tile", tile_values * keyframe.dtype.itemsize, file_bytes)


def read_png(path: Path, *, from_header: bool = False) -> tuple[Frames, None, None]:
    """Return the levels of a PNG as one image, (1, H, W), without a description or a note.

    They are decoded once to check them, or later if the header alone states their shape.
    """
    file = FileReader(path)

    def load() -> npt.NDArray[Any]:
        content = file.read(0, file.size).tobytes()
        try:
            return _decode_png(content)[None]
        except (OSError, ValueError, SyntaxError) as error:
            raise ValueError(f"{path}: the PNG cannot be read as counts ({error})") from error

    if from_header or remote_file(path) is not None:
        shape, dtype = _describe_png(path)
    else:
        image = load()
        shape, dtype = image.shape, image.dtype
    return Frames(shape, lambda start, stop: load()[start:stop], dtype), None, None


def _describe_png(path: Path) -> tuple[tuple[int, int, int], np.dtype[Any]]:
    """Return the shape and the type of the levels of a PNG from its header alone."""
    try:
        with open_binary(path) as file:
            header = read_png_header(file.read(HEADER_BYTES))
        _refuse_color(header)
    except ValueError as error:
        raise ValueError(f"{path}: the PNG cannot be read as counts ({error})") from error
    is_bits = header.depth == 1 and header.color_type == GRAYSCALE
    kind = np.bool_ if is_bits else np.uint16 if header.depth == 16 else np.uint8
    return (1, header.height, header.width), np.dtype(kind)


def _refuse_color(header: PngHeader) -> None:
    """Raise ValueError unless a PNG has one level per pixel."""
    if header.color_type not in (GRAYSCALE, PALETTE):
        raise ValueError(
            "expected gray levels, got color or transparency; if it is a photograph, `jotlight "
            "simulate` makes a capture of it"
        )


def _decode_png(content: bytes) -> npt.NDArray[Any]:
    """Return the levels of a PNG as the file stores them, (H, W)."""
    from PIL.PngImagePlugin import PngImageFile

    header = check_png(content)
    _refuse_color(header)
    shape = header.height, header.width
    # Image.open would refuse large captures; check_png has checked the size.
    with PngImageFile(io.BytesIO(content)) as image:
        levels = np.asarray(image)
    if levels.shape != shape:
        raise ValueError(f"expected levels of shape {shape}, got {levels.shape}")
    if header.color_type == GRAYSCALE and header.depth in _PILLOW_SCALE:
        levels = levels // _PILLOW_SCALE[header.depth]
    return levels


PNG = Format(
    "png",
    "counts in a grayscale PNG, or in a folder of them",
    open=open_png,
    matches=lambda path: _matches(path, "png", _PNG_EXTENSIONS),
    extensions=_PNG_EXTENSIONS,
    writer=Writer(counts=write_png, extensions=_PNG_EXTENSIONS),
)

TIFF = Format(
    "tiff",
    "counts in a TIFF, or in a folder of them",
    open=open_tiff,
    matches=lambda path: _matches(path, "tiff", _TIFF_EXTENSIONS),
    extensions=_TIFF_EXTENSIONS,
    writer=Writer(
        counts=write_tiff,
        readings=write_tiff_readings,
        extensions=_TIFF_EXTENSIONS,
        keeps_label=True,
    ),
    verify=_verify_tiff,
)
