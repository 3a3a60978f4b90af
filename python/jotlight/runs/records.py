"""Records of results: what they were made of, and how."""

import json
import stat
from pathlib import Path
from typing import Any

ATTRIBUTE = "jotlight"
"""Attribute of the array that holds the record."""

_MAX_JSON_BYTES = 1 << 22

_STATE = "bytes", "modified"
"""Values of a run that differ if its capture has changed."""

_SHA256 = "_sha256"
"""End of the names of checksums in a run."""

Record = dict[str, Any]
"""What an array was made of, and how, as JSON."""


class AnotherRunError(ValueError):
    """An output exists that was made from other data, or in another way."""


def read_record(path: Path) -> Record:
    """Return the record of a finished array, or an empty one if jotlight did not make it.

    Raises
    ------
    OSError, ValueError
        When its description cannot be read.
    """
    description = path / "zarr.json"
    attributes = read_json(description).get("attributes") if description.is_file() else None
    record = attributes.get(ATTRIBUTE) if isinstance(attributes, dict) else None
    return record if isinstance(record, dict) else {}


def check_same_run(path: Path, stored: Any, expected: Record, record: Path | None = None) -> None:
    """Raise AnotherRunError unless the stored run of a result is the expected one.

    `record` is the file of the stored run, if it lies beside the result.
    """
    if stored == expected:
        return
    if not isinstance(stored, dict):
        raise AnotherRunError(
            f"{path}: exists already, and is not the result of such a run; choose another name"
        )
    # Checksums follow from the rest, and another capture has another state.
    names = set(_differing(stored, expected))
    has_changed = bool(names & set(_STATE))
    rest = {name for name in names - set(_STATE) if not (has_changed and _SHA256 in name)}
    if rest:
        was, now = ({name: run[name] for name in rest & run.keys()} for run in (stored, expected))
        reason = ", and ".join(_differences(was, now))
    else:
        reason = "the capture has changed since"
    files = "it" if record is None else f"it and {record.name}"
    raise AnotherRunError(
        f"{path}: belongs to another run: {reason}; delete {files}, or choose another name for the "
        "output"
    )


def _differing(stored: Record, expected: Record) -> list[str]:
    """Return the names of the values that differ, sorted."""
    names = sorted(stored.keys() | expected.keys())
    return [name for name in names if stored.get(name) != expected.get(name)]


def _differences(stored: Any, expected: Any, of: str = "") -> list[str]:
    """Return the values of two objects of JSON that differ, as texts.

    If some are plain, they are all that is stated. Those of the parts of a run, such as the sensor,
    follow from them, and so do most checksums.
    """
    names = _differing(stored, expected)
    pairs = {f"{of}{name}": (stored.get(name), expected.get(name)) for name in names}
    plain = [
        f"its {name} was {_short(found)}, and is {_short(wanted)} now"
        for name, (found, wanted) in pairs.items()
        if not (isinstance(found, dict) and isinstance(wanted, dict)) and _SHA256 not in name
    ]
    parts = [
        text
        for name, (found, wanted) in pairs.items()
        if isinstance(found, dict) and isinstance(wanted, dict)
        for text in _differences(found, wanted, f"{name} ")
    ]
    checksums = [f"its {name.replace(_SHA256, '')} changed" for name in pairs if _SHA256 in name]
    return plain or parts or checksums


def _short(value: Any) -> str:
    text = "none" if value is None else json.dumps(value)
    return text if len(text) <= 100 else f"{text[:100]}…"


def read_json(path: Path, max_bytes: int = _MAX_JSON_BYTES) -> Record:
    """Return an object of JSON from a file that may be damaged."""
    state = path.stat()
    if not stat.S_ISREG(state.st_mode):  # reading a pipe would wait for a program that writes
        raise ValueError(f"{path}: is damaged: expected a file")
    if state.st_size > max_bytes:
        raise ValueError(f"{path}: expected at most {max_bytes} bytes; it is damaged")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: is damaged ({error})") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: is damaged: expected an object of JSON")
    return content
