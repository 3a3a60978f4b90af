"""MATLAB: a `.mat` with frames (H, W, T), or a folder of `part_1.mat`, `part_2.mat` and so on."""

import dataclasses
import io
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.files import atomic_folder
from jotlight.formats.capture import Capture
from jotlight.formats.files.checksums import check_seal, file_checksum, is_sealed, seal
from jotlight.formats.files.file_lists import natural_sort_key
from jotlight.formats.files.file_sequence import describe_files, join_files
from jotlight.formats.files.magic import has_type
from jotlight.formats.files.safe_paths import check_inside
from jotlight.formats.format import Format, Writer
from jotlight.formats.frames.count_stacks import as_count_stack
from jotlight.formats.frames.packing import pack_lazily
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.hdf5.captures import load_library
from jotlight.formats.matlab.files import VARIABLE, open_mat
from jotlight.formats.matlab.sizes import COMPRESSED, HEADER_BYTES
from jotlight.interrupts import interruptible
from jotlight.output_files import open_output
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import warn_about_axes
from jotlight.sensing.parameters.provenance import Provenance

_FRAMES_PER_PART, _BYTES_PER_PART = 256, 1 << 26
"""Maximum number of frames, and of their bytes, in each file that jotlight writes."""

_HEADER, _TEXT_BYTES = b"MATLAB 5.0 MAT-file, written by jotlight", 116
"""Text at the beginning of each file that jotlight writes, and the length of the place for it."""

_INFO = "info.json"
"""Name of the file that describes the parts."""

_FORMAT, _VERSION = "jotlight MATLAB parts", 1
"""Values of "format" and "version" in the `info.json` that jotlight writes."""

_MAX_INFO_BYTES = 1 << 26
"""Maximum size of `info.json`, which has a checksum for each part."""


def _is_matlab(path: Path) -> bool:
    if path.is_dir():
        return next(path.glob("part_*.mat"), None) is not None
    return has_type(path, "matlab")


def open_matlab(path: Path, options: ReadingOptions) -> Capture:
    """Return the capture in a `.mat` file, or in a folder of parts in natural order."""
    files, notes, info = [path], [], None
    if path.is_dir():
        files = _part_files(path)
        info = _read_info(path, [file.name for file in files])
        if len(files) > 1:
            notes.append(describe_files(path, files))
    elif not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    checksums = {} if info is None else info.checksums
    library = load_library(options.isolate)
    parts = [open_mat(file, options.key, library, checksums.get(file.name)) for file in files]
    if len({part.shape[1:] for part in parts}) != 1:
        raise ValueError(f"{path}: expected parts of one height and width")
    frames = join_files(path, files, parts)
    if checksums and info is not None and info.frames != len(frames):
        raise ValueError(f"{path}: expected {info.frames} frames, got {len(frames)}; it is damaged")
    if info is not None and info.frames < len(frames):
        notes.append(f"the first {info.frames} of {len(frames)} frames, as {_INFO} states")
        frames = frames[: info.frames]
    if 0 in frames.shape:
        raise ValueError(f"{path}: expected frames without a dimension of 0, got {frames.shape}")
    if not checksums:
        warn_about_axes(path.name, parts[0].shape, frames_last=True)
    provenance = Provenance("matlab", path.name, tuple(notes))
    if options.takes_counts:
        return as_count_stack(frames, provenance, floats=options.takes_floats, is_stack=True)
    provenance = provenance.with_notes("each number is one bit, (H, W, T)")
    packed = pack_lazily(frames, path.name)
    if len(packed) == 1:  # a matrix may hold counts, which any number of frames would not fit
        packed.read(0, 1)
    return Bits(packed, frames.shape[2], provenance=provenance)


def _part_files(folder: Path) -> list[Path]:
    """Return the parts in a folder in natural order."""
    files = sorted(folder.glob("part_*.mat"), key=natural_sort_key)
    if not files:
        raise ValueError(f"{folder}: expected part_1.mat and so on, got none")
    return [check_inside(file, folder) for file in files]


def _verify(path: Path) -> int:
    """Return how many files have checksums in `info.json`. Reading the frames compares them."""
    if not path.is_dir():
        return 0
    info = _read_info(path, [file.name for file in _part_files(path)])
    return 1 + len(info.checksums) if info is not None and info.checksums else 0


@dataclasses.dataclass(frozen=True)
class _Info:
    """The content of `info.json`."""

    frames: int
    checksums: dict[str, str]
    """SHA-256 of each part, or empty if jotlight did not write the folder."""


def _read_info(folder: Path, parts: list[str]) -> _Info | None:
    """Return the content of `info.json`, or None if there is no such file."""
    path = folder / _INFO
    if not path.is_file():
        return None
    check_inside(path, folder)
    try:
        if path.stat().st_size > _MAX_INFO_BYTES:
            raise ValueError("it is too long")
        text = path.read_text(encoding="utf-8")
        if is_sealed(text):
            check_seal(text, str(path))
        info = json.loads(text)
        if is_sealed(text):
            del info["checksum"]
        stated_parts, stated_frames = info["no_parts"], info["no_frames"]
        if type(stated_parts) is not int or type(stated_frames) is not int or stated_frames < 1:
            raise ValueError(f"got {stated_parts!r} and {stated_frames!r}")
        if is_sealed(text) or info.get("format") == _FORMAT:
            _check_own_info(info, parts)
            return _Info(stated_frames, info["parts"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        if str(error).startswith(str(path)):
            raise
        raise ValueError(
            f"{path}: expected whole numbers no_parts and no_frames ({error})"
        ) from error
    if stated_parts != len(parts):
        warn(
            f"{folder}: {_INFO} states {stated_parts} parts, but there are {len(parts)}; all are "
            "used"
        )
    return _Info(stated_frames, {})


def _check_own_info(info: dict[str, Any], parts: list[str]) -> None:
    """Raise ValueError unless `info.json` is one that jotlight wrote for these parts."""
    if info.get("format") != _FORMAT or info.get("version") != _VERSION:
        raise ValueError(f"expected format {_FORMAT!r}, version {_VERSION}")
    unknown = info.keys() - {"format", "version", "no_parts", "no_frames", "parts"}
    if unknown:
        raise ValueError(f"got unknown entries {', '.join(sorted(unknown))}")
    checksums = info["parts"]
    if not isinstance(checksums, dict) or list(checksums) != parts:
        raise ValueError(f"expected the parts that it lists, got {', '.join(parts)[:200]}")
    if info["no_parts"] != len(parts):
        raise ValueError(f"got {info['no_parts']} parts and a list of {len(parts)}")
    if not all(isinstance(checksum, str) for checksum in checksums.values()):
        raise ValueError("expected checksums of all parts")


def _write_bits(bits: Bits, path: Path) -> None:
    """Write a folder of parts and `info.json`."""
    if len(bits.shape) != 3:
        raise ValueError(
            f"matlab: expected bits of one channel, got {bits.shape[3]}; write to a name that ends "
            "in .npy"
        )
    frames, height, width = bits.shape
    part_frames = max(1, min(_FRAMES_PER_PART, _BYTES_PER_PART // (height * width)))
    checksums = {}
    with atomic_folder(path) as folder:
        for index, start in enumerate(range(0, frames, part_frames)):
            part = bits.packed[start : start + part_frames, ...]
            unpacked = np.unpackbits(np.asarray(part), axis=2, count=width)
            file = folder / f"part_{index + 1}.mat"
            with open_output(file) as output:
                for content in interruptible(_make_part)(unpacked):
                    output.write(content)
            checksums[file.name] = file_checksum(file)
        # Other software reads no_parts and no_frames.
        info = {
            "format": _FORMAT,
            "version": _VERSION,
            "no_parts": len(checksums),
            "no_frames": frames,
            "parts": checksums,
        }
        with open_output(folder / _INFO) as output:
            output.write(seal(info).encode())


def _make_part(frames: npt.NDArray[np.uint8]) -> tuple[bytes, bytes, bytes]:
    """Return the content of a `.mat` of frames (T, H, W): its header, a tag, and the variable.

    The variable is compressed here, because SciPy would search for long matches. In bits, they take
    long to find, and make the file hardly smaller.
    """
    from scipy.io import savemat

    stream = io.BytesIO()
    # SciPy keeps a third dimension of 1, which MATLAB itself would drop.
    savemat(stream, {VARIABLE: np.moveaxis(frames, 0, 2)})
    content = stream.getbuffer()
    # SciPy writes the time into the text; without it, equal frames make equal files.
    header = _HEADER.ljust(_TEXT_BYTES) + content[_TEXT_BYTES:HEADER_BYTES]
    compressor = zlib.compressobj(strategy=zlib.Z_RLE)
    variable = compressor.compress(content[HEADER_BYTES:]) + compressor.flush()
    return header, struct.pack("=II", COMPRESSED, len(variable)), variable


MATLAB = Format(
    "matlab",
    "MATLAB, a .mat or a folder of parts",
    open=open_matlab,
    matches=_is_matlab,
    extensions=(".mat",),
    has_keys=True,
    verify=_verify,
    writer=Writer(bits=_write_bits, folder=True),
)
