"""The origin of a result, as `jotlight info` shows it."""

from pathlib import Path
from typing import Any

from jotlight.dask.store import PART, open_unfinished, read_json, read_record
from jotlight.images.io import read_note

_NOTED = (".tif", ".tiff", ".exr", ".png", ".jpg", ".jpeg")
"""Endings of images that contain a note."""

Facts = list[tuple[str, str]]


def origin_facts(path: Path) -> Facts:
    """Return the rows about what a result was made of, and how; none for other files.

    Parameters
    ----------
    path : path
        A zarr folder of images, finished or not; or an image or a copy with a record beside it.
    """
    if path.is_dir():
        if path.name.endswith(PART) and (path / "run.json").is_file():
            store = open_unfinished(path)
            done = store.groups - len(store.missing())
            state = f"unfinished: {done} of {store.groups} groups of images"
            return [("kind", f"video, {state}"), _images(store.shape), *_run_facts(store.run)]
        record = read_record(path) if (path / "zarr.json").is_file() else {}
        if not isinstance(record.get("run"), dict):
            return []
        shape = read_json(path / "zarr.json").get("shape", [])
        is_counts = record["run"].get("values") == "int32"
        kind = "counts of windows" if is_counts else "video"
        return [("kind", kind), _images(shape), *_record_facts(record)]
    record_path = path.with_name(f"{path.name}.json")
    if not record_path.is_file():
        return _note_facts(path)
    try:
        record = read_json(record_path)
    except ValueError:  # the description of a capture, which its reader checks
        return []
    return _record_facts(record) if isinstance(record.get("run"), dict) else []


def _note_facts(path: Path) -> Facts:
    """Return the rows of the note that an image contains."""
    if path.suffix.lower() not in _NOTED:
        return []
    note = read_note(path)
    if "jotlight" in note:
        return _record_facts(note["jotlight"])
    names = ("capture", "bytes", "method", "weights_sha256", "calibration_sha256", "software")
    facts = [(name.replace("_sha256", ""), _text(note[name])) for name in names if note.get(name)]
    facts += [
        ("read", f"{note.get(f'{content}_bytes')} bytes, crc32 {note[f'{content}_crc32']}")
        for content in ("packed", "counts")
        if f"{content}_crc32" in note
    ]
    if isinstance(note.get("sensor"), dict):
        facts.append(("sensor", _text(note["sensor"])))
    return facts


def _images(shape: Any) -> tuple[str, str]:
    number, *size = shape
    return "shape", f"{number} images of {' x '.join(map(str, size))}"


def _record_facts(record: dict[str, Any]) -> Facts:
    facts = _run_facts(record["run"])
    read = record.get("input", {})
    if "packed_crc32" in read:
        used = f"{read.get('packed_bytes')} bytes of packed frames, crc32 {read['packed_crc32']}"
        facts.append(("read", used))
    if "minimum" in record:
        facts.append(("values", f"{record['minimum']:.4g} to {record['maximum']:.4g}"))
    return facts


def _run_facts(run: dict[str, Any]) -> Facts:
    facts = [
        ("capture", f"{run.get('file') or run.get('capture')}, {run.get('bytes')} bytes"),
        ("format", str(run.get("format"))),
        ("bits", " x ".join(map(str, run.get("bits", [])))),
    ]
    if "window" in run:
        facts.append(("windows", f"{run['window']} frames, one from each {run.get('step')}"))
    for name, label in (
        ("method", "method"),
        ("options", "options"),
        ("weights_sha256", "weights"),
        ("sensor", "sensor"),
        ("maps_sha256", "maps"),
        ("calibration", "calibration"),
        ("to", "converted to"),
        ("jotlight", "jotlight"),
    ):
        if value := run.get(name):
            facts.append((label, _text(value)))
    return facts


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name}={each}" for name, each in value.items())
    return str(value)
