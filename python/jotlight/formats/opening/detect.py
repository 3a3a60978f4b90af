"""Detection of the format of a file or folder from its content."""

import glob
import shlex
from collections import Counter
from pathlib import Path

from jotlight.errors import counted
from jotlight.formats.files.magic import file_type
from jotlight.formats.format import Format
from jotlight.formats.images.captures import PNG, TIFF
from jotlight.formats.opening.locations import check_exists
from jotlight.formats.registry import FORMATS

PHOTOGRAPH_EXTENSIONS = (".jpg", ".jpeg", ".bmp", ".webp", ".pgm", ".ppm", ".gif")
"""Extensions of images that are never captures."""

_OTHERS = {
    ".safetensors": "which holds a network, a calibration, or a motion; jotlight.Network.load, "
    "jotlight.Calibration.load, and jotlight.Motion.load read them",
    **dict.fromkeys(
        (".mp4", ".avi", ".mov", ".mkv"),
        "which holds a video; other programs read its frames, and jotlight.Bits.from_array takes "
        "frames of 0 and 1",
    ),
    **dict.fromkeys(
        (".csv", ".txt"),
        "which holds text; numpy.loadtxt reads an image of counts from it, which "
        "jotlight.reconstruct takes with its sensor",
    ),
    ".json": "which describes a capture; open the capture itself, such as the .npy beside it",
}
"""What files with other extensions hold, and what to do with them."""


def detect_format(path: Path) -> str:
    """Return the name of the format of a file or folder.

    Raises
    ------
    OSError
        When the path cannot be read.
    ValueError
        When no format matches, or a folder holds files of several formats. Raw frames have no
        header, so most of them match none.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "capture.bin"
    >>> _ = path.write_bytes(bytes(32768) + b"DONE")
    >>> detect_format(path)
    'spad512s'
    """
    check_exists(path)
    # Raw formats match by a trailer, so formats with a header come first.
    for format_ in sorted(FORMATS.values(), key=lambda format_: format_.is_raw):
        if format_.matches is not None and format_.matches(path):
            if path.is_dir() and format_ in (PNG, TIFF):
                _refuse_several_formats(path, format_)
            return format_.name
    extension = path.suffix.lower()
    if any(extension in format_.extensions for format_ in FORMATS.values()):
        if path.is_dir():
            raise IsADirectoryError(f"{path}: expected a {path.suffix} file, got a folder")
        if file_type(path) is None:
            raise ValueError(
                f"{path}: expected a {extension} file by its name, but it does not begin like one"
            )
    if extension in PHOTOGRAPH_EXTENSIONS and path.is_file():
        raise ValueError(
            f"{path}: a {extension} file holds a photograph, not bits or counts; "
            f"`jotlight simulate {path.name}` (sensor.expose(jotlight.read_image(path))) makes a "
            "capture of it"
        )
    if extension in _OTHERS:
        raise ValueError(f"{path}: expected a capture, got a {extension}, {_OTHERS[extension]}")
    if path.is_dir():
        _explain_folder(path)
    raw = ", ".join(name for name, each in FORMATS.items() if each.is_raw and name != "raw")
    others = ", ".join(name for name, format_ in FORMATS.items() if not format_.is_raw)
    raise ValueError(
        f"{path}: its content does not identify its format; pass format= (--format): "
        f"{raw} for raw frames, or else one of {others}; for raw frames of another camera, pass "
        'their layout, such as layout="256x512" (--layout 256x512)'
    )


def _capture_extensions(*, is_raw: bool) -> set[str]:
    """Return the extensions of all formats with a header, or of all raw formats."""
    formats = (each for each in FORMATS.values() if each.is_raw == is_raw)
    return {
        extension
        for each in formats
        for extension in (*each.extensions, *(each.writer.extensions if each.writer else ()))
    }


def _refuse_several_formats(folder: Path, format_: Format) -> None:
    """Raise ValueError if a folder of images also holds captures of other formats.

    Other folders of one capture have files whose names identify it, whatever lies beside them.
    """
    files = sorted(each for each in folder.iterdir() if each.name[0] != ".")
    captures = _capture_extensions(is_raw=False) - set(format_.extensions)
    own, others = (
        [file.name for file in files if file.name.lower().endswith(tuple(extensions))]
        for extensions in (format_.extensions, captures)
    )
    if own and others:
        raise ValueError(
            f"{folder}: expected one capture, got files of several formats, such as "
            f"{others[0]} and {own[0]}; name one of them, or pass "
            f"format={format_.name!r} (--format {format_.name}) to read only "
            f"{' and '.join(format_.extensions)} files as the frames of one capture"
        )


def _explain_folder(folder: Path) -> None:
    """Raise ValueError for a folder without files, with photographs, or with many captures."""
    if not any(folder.iterdir()):
        raise ValueError(f"{folder}: expected a capture, got an empty folder")
    endings = Counter(each.suffix for each in sorted(folder.iterdir()) if each.is_file())
    captures = _capture_extensions(is_raw=False)
    # A folder of raw files may be one capture.
    if any(ending.lower() in _capture_extensions(is_raw=True) for ending in endings):
        return
    endings.pop(".json", None)  # descriptions
    if not endings:
        return
    ending = max(endings, key=endings.__getitem__)
    number = endings[ending]
    if ending.lower() in PHOTOGRAPH_EXTENSIONS:
        raise ValueError(
            f"{folder}: holds {counted(number, f'{ending} photograph')}, not bits or counts; "
            "`jotlight simulate` (sensor.expose(image)) makes a capture of a photograph"
        )
    if ending.lower() in captures:
        pattern = shlex.quote(f"{glob.escape(str(folder))}/*{ending}")
        raise ValueError(
            f"{folder}: holds {counted(number, f'{ending} file')}; name one of them, or pass "
            f"the pattern {pattern} to `jotlight reconstruct`, `jotlight convert`, or "
            "jotlight.open"
        )
