"""The origin of a result, as `jotlight info` shows it."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jotlight.cli.captures.applied_calibration import record_path
from jotlight.cli.reports.capture_facts import provenance_rows
from jotlight.cli.terminal.console import shape_text
from jotlight.evaluation.records.records import FORMAT
from jotlight.formats.files.checksums import file_checksum
from jotlight.formats.files.safe_paths import check_inside
from jotlight.images.io import read_image, read_note
from jotlight.runs.jobs import conversion_record
from jotlight.runs.records import read_json, read_record
from jotlight.runs.store import PART, open_finished, open_unfinished
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.provenance import Provenance

_NOTED = (".tif", ".tiff", ".exr", ".png", ".jpg", ".jpeg")
"""Endings of images that contain a note."""

_HOW = (
    *(
        "options",
        "found",
        "motion",
        "model",
        "weights_sha256",
        "maps_sha256",
        "hot_jots",
        "calibration_sha256",
    ),
    *("curve", "white"),
)
"""Names of the facts that say how an image or a film was made."""

Facts = list[tuple[str, str]]


def video_facts(path: Path) -> Facts:
    """Return the rows about a zarr folder of images, finished or not; none for other folders."""
    if _is_unfinished(path):
        store = open_unfinished(path)
        done = store.markers.done()
        state = f"unfinished: {len(done)} of {store.groups} groups of images"
        return [("kind", f"video, {state}"), _images(store.shape), *_run_facts(store.run)]
    if not _is_finished(path):
        return []
    store = open_finished(path)
    store.check_files()
    kind = "counts of windows" if store.dtype == "int32" else "video"
    return [("kind", kind), _images(store.shape), *_record_facts(read_record(path))]


def film_facts(path: Path) -> Facts:
    """Return the rows about a film for display: a .mp4, a .gif, or a folder of .png.

    There are none for other paths.
    """
    unknown = [("origin", f"unknown: there is no {record_path(path).name} beside it")]
    if path.suffix.lower() == ".mp4" and path.is_file():
        return [("kind", "film"), *(origin_facts(path) or unknown)]
    if path.suffix.lower() == ".gif" and path.is_file():
        shape = _shape_of_gif(path)
        return [("kind", "film"), _images(shape), *(origin_facts(path) or unknown)] if shape else []
    images = sorted(filter(Path.is_file, path.glob("*.png"))) if path.is_dir() else []
    facts = (origin_facts(path) or _note_facts(check_inside(images[0], path))) if images else []
    if not is_film(facts):
        return []
    return [("kind", "film"), _images((len(images), *read_image(images[0]).shape)), *facts]


def is_film(facts: Facts) -> bool:
    """Return whether the rows about the origin of a result are those of a film."""
    return "window" in dict(facts)


def _shape_of_gif(path: Path) -> tuple[int, ...]:
    """Return the number, height, and width of the images of an animation; () for other files."""
    from PIL import Image

    try:
        with Image.open(path, formats=("GIF",)) as file:
            number = getattr(file, "n_frames", 1)
            return (number, file.height, file.width) if number > 1 else ()
    except Exception:  # any type: reading the file as an image reports the error
        return ()


def _is_finished(path: Path) -> bool:
    """Return whether a path is a zarr folder of images that jotlight made of windows."""
    is_zarr = (path / "zarr.json").is_file()
    return is_zarr and isinstance(read_record(path).get("run"), dict)


def verify_video(path: Path, progress: Callable[[float], object]) -> str | None:
    """Return a sentence about the checksums of the images of a video, or None for other files.

    Raises
    ------
    ValueError
        When an image is missing or damaged, or the video is not finished.
    """
    if _is_unfinished(path):
        raise ValueError(
            f"{path}: --verify is for finished videos; repeat the command that makes this one"
        )
    if not _is_finished(path):
        return None
    store = open_finished(path)
    store.check_images(progress)
    number = store.shape[0]
    return (
        "1 image matches its checksum" if number == 1 else f"{number} images match their checksums"
    )


def verify_result(path: Path) -> str | None:
    """Return a sentence about the checksum of a film or an image, or None without one.

    Raises
    ------
    ValueError
        When the file differs from its checksum, or is a folder of images, which has none.
    """
    record_file = record_path(path)
    record = _read_record(record_file) or {}
    if record.get("format") != FORMAT:
        return None
    if path.is_dir():
        raise ValueError(
            f"{path}: {record_file.name} has no checksums of the images of a folder; --verify is "
            "for captures, for videos, and for films in one file"
        )
    if "sha256" not in record:
        return None
    if file_checksum(path) != record["sha256"]:
        raise ValueError(
            f"{path}: the file does not match its SHA-256 in {record_file.name}: it is damaged, or "
            "another file; make it again"
        )
    return f"the file matches its SHA-256 in {record_file.name}"


def _is_unfinished(path: Path) -> bool:
    return path.name.endswith(PART) and (path / "run.json").is_file()


def origin_facts(path: Path) -> Facts:
    """Return the rows about what a result was made of, and how; none for other files.

    Parameters
    ----------
    path : path
        An image, a film, or a copy of a capture, which contains a note or has a record beside it.
    """
    for record_file in (conversion_record(path), record_path(path)):
        record = _read_record(record_file)
        if record is None:
            continue
        if path.is_file() and record.get("sha256", "") not in ("", file_checksum(path)):
            return [("origin", f"unknown: {record_file.name} is the record of another file")]
        if isinstance(record.get("origin"), dict):
            return _origin_rows(record["origin"])
        if isinstance(record.get("run"), dict):
            return _record_facts(record)
    return _note_facts(path)


def _read_record(path: Path) -> dict[str, Any] | None:
    """Return a record beside a result, or None if there is none."""
    try:
        return read_json(path) if path.is_file() else None
    except ValueError:  # the description of a capture, which its reader checks
        return None


def _note_facts(path: Path) -> Facts:
    """Return the rows of the note that an image contains."""
    if path.suffix.lower() not in _NOTED:
        return []
    note = read_note(path)
    if "jotlight" in note:
        return _record_facts(note["jotlight"])
    return _origin_rows(note)


def _origin_rows(origin: dict[str, Any]) -> Facts:
    first = (
        "capture",
        "photographs",
        "photographs_sha256",
        "bytes",
        "frames",
        "window",
        "step",
        "method",
        "difference_to",
    )
    names = (*first, *_HOW, "software")
    facts = [(_label(name), _text(origin[name])) for name in names if origin.get(name)]
    facts += [
        ("read", f"{origin.get(f'{content}_bytes')} bytes, crc32 {origin[f'{content}_crc32']}")
        for content in ("packed", "counts")
        if f"{content}_crc32" in origin
    ]
    if isinstance(origin.get("sensor"), dict):
        facts.append(("sensor", _text(origin["sensor"])))
    return [*facts, *_provenance(origin.get("provenance"))]


def _provenance(stored: Any) -> Facts:
    """Return the rows about how the frames were read: which of them, turned, and assumptions.

    `stored` is an object of :meth:`Provenance.to_json`, or None.
    """
    if stored is None:
        return []
    try:
        return provenance_rows(Provenance.from_json(stored))
    except ValueError as error:
        return [("provenance", f"damaged ({error})")]


def _images(shape: Any) -> tuple[str, str]:
    number, *size = shape
    return "shape", f"{number} images of {shape_text(size)}"


def _record_facts(record: dict[str, Any]) -> Facts:
    facts = _run_facts(record["run"])
    read = record.get("input", {})
    for content, title in (("packed", "packed frames"), ("counts", "counts")):
        if f"{content}_crc32" in read:
            size, checksum = read.get(f"{content}_bytes"), read[f"{content}_crc32"]
            facts.append(("read", f"{size} bytes of {title}, crc32 {checksum}"))
    names = "found", "curve", "white"
    facts += [(name, _text(record[name])) for name in names if record.get(name)]
    if "minimum" in record:
        facts.append(("values", f"{record['minimum']:.4g} to {record['maximum']:.4g}"))
    return facts


def _shapes(run: dict[str, Any]) -> Facts:
    return [(name, shape_text(run[name])) for name in ("bits", "counts") if name in run]


def _run_facts(run: dict[str, Any]) -> Facts:
    facts = [
        ("capture", f"{run.get('file') or run.get('capture')}, {run.get('bytes')} bytes"),
        ("format", str(run.get("format"))),
        *_shapes(run),
        *_provenance(run.get("provenance")),
    ]
    if "window" in run:
        facts.append(("windows", f"{run['window']} frames, one from each {run.get('step')}"))
    how = "method", "options", "model", "weights_sha256", "sensor", "maps_sha256", "calibration"
    facts += [
        (_label(name), _text(run[name])) for name in (*how, "to", "jotlight") if run.get(name)
    ]
    return facts


def _label(name: str) -> str:
    """Return the name of a row about an entry of a record."""
    named = {"photographs_sha256": "SHA-256", "to": "converted to"}
    return named.get(name, name.replace("_sha256", "").replace("_", " "))


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name}={_setting(name, each)}" for name, each in value.items())
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return str(value)


def _setting(name: str, value: Any) -> str:
    """Return the value of a sensor's setting or of a method's option."""
    if name == "mosaic" and value is not None:
        with contextlib.suppress(ValueError):  # of a damaged record
            return repr(Mosaic.of(value))
    return f"({_text(value)})" if isinstance(value, dict) else str(value)
