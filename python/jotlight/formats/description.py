"""What a photon cube cannot say, in a `.json` beside it: true width, sensor and provenance."""

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from jotlight.errors import warn
from jotlight.formats.arrays import read_npy
from jotlight.sensing.bits import SensorLike
from jotlight.sensing.maps import MAPS
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor

BITS = "jotlight bits"
COUNTS = "jotlight counts"
"""What our descriptions and labels call themselves."""
_VERSION = 1

_MOST_JSON = 1 << 20
"""Bytes of a description that are read at most."""


def describe(
    width: int, sensor: SensorLike | None, provenance: Provenance | None
) -> dict[str, Any]:
    """What goes into the `.json`; the names of files with maps are the caller's to add."""
    description: dict[str, Any] = {"format": BITS, "version": _VERSION, "width": width}
    if sensor is not None:
        description["sensor"] = sensor.scalars()
        description["maps"] = {}
    if provenance is not None:
        description["provenance"] = provenance.to_json()
    return description


def make_counts_label(frames: int | None, provenance: Provenance | None) -> str | None:
    """What goes into a file beside counts: out of how many bits each is, and where it is from."""
    if frames is None and provenance is None:
        return None
    told: dict[str, Any] = {"format": COUNTS, "version": _VERSION, "frames": frames}
    return json.dumps({**told, "provenance": None if provenance is None else provenance.to_json()})


def read_counts_label(label: str | None) -> tuple[int | None, Provenance | None]:
    """Undo :func:`make_counts_label`; nothing where the label is none of ours."""
    told = parse_label(label, COUNTS) if label is not None and len(label) <= _MOST_JSON else None
    if told is None:
        return None, None
    frames, provenance = told.get("frames"), told.get("provenance")
    if told.get("version") != _VERSION or (frames is not None and type(frames) is not int):
        raise ValueError(f"label: expected version {_VERSION} and a whole number of frames")
    if frames is not None and not 1 <= frames < 2**31:
        raise ValueError(f"label: expected 1 to 2**31 - 1 frames, got {frames}")
    return frames, None if provenance is None else Provenance.from_json(provenance)


def description_path(path: Path) -> Path:
    """Where the description of a cube is written."""
    if path.suffix.lower() == ".gz":
        return path.with_name(f"{path.name}.json")
    return path.with_suffix(".json")


def _json_of(path: Path) -> Path:
    """The description that a cube is read with.

    One that was compressed by other means has that of the `.npy` it was, unless that is there too.
    """
    beside, plain = description_path(path), path.with_suffix("")
    if beside.is_file() or path.suffix.lower() != ".gz" or plain.exists():
        return beside
    return description_path(plain)


def companion_files(path: Path) -> set[Path]:
    """The files that bits in `path` have beside them: their description and the sensor's maps."""
    if path.suffix.lower() not in (".npy", ".gz"):
        return set()
    besides = {description_path(path), _json_of(path)}
    return besides.union(*map(maps_in_description, besides))


def maps_in_description(beside: Path) -> set[Path]:
    """The maps in the same folder that a description of ours names."""
    description = (read_own_description(beside) or {}) if beside.is_file() else {}
    maps = description.get("maps")
    names = maps.values() if isinstance(maps, dict) else ()
    stem = beside.name.removesuffix(".json")
    ours = {f"{stem}.{name}.npy" for name in MAPS}
    return {beside.parent / name for name in names if name in ours}


def read_description(
    path: Path, shape: tuple[int, ...]
) -> tuple[int | None, Sensor | None, Provenance | None]:
    """The width, the sensor and the provenance that the `.json` beside a cube of this shape tells."""
    beside = _json_of(path)
    if not beside.is_file():
        return None, None, None
    description = read_own_description(beside)
    if description is None:
        warn(f"{beside} does not describe bits of jotlight and is not used")
        return None, None, None
    width = description.get("width")
    if description.get("version") != _VERSION or not isinstance(width, int) or width < 1:
        raise ValueError(
            f"{beside}: expected version {_VERSION} and a width, got version "
            f"{description.get('version')!r} and width {width!r}"
        )
    if description.get("shape", list(shape)) != list(shape):
        raise ValueError(
            f"{beside}: describes a cube of shape {description['shape']}, and {path.name} has "
            f"{list(shape)}; it belongs to another, so move it away"
        )
    try:
        told = description.get("provenance")
        provenance = None if told is None else Provenance.from_json(told)
        if description.get("sensor") is None:
            return width, None, provenance
        files = description.get("maps") or {}
        if not isinstance(files, dict) or not files.keys() <= set(MAPS):
            raise ValueError(f"maps: expected files for {' and '.join(MAPS)}, got {files!r}")
        maps = {
            name: np.array(read_npy(resolve_sibling(path, file))) for name, file in files.items()
        }
        return width, Sensor.from_parts(description["sensor"], maps), provenance
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{beside}: {error}") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{beside}: {error}") from error


def read_own_description(path: Path) -> dict[str, Any] | None:
    """The description of bits in a file, or None when it is none of ours."""
    if path.stat().st_size > _MOST_JSON:
        return None
    try:
        return parse_label(path.read_text(encoding="utf-8"), BITS)
    except ValueError:
        return None


def parse_label(text: str, format_: str) -> dict[str, Any] | None:
    """The object of this format in a text, or None."""
    try:
        told = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return told if isinstance(told, dict) and told.get("format") == format_ else None


def resolve_below(path: Path, name: object, what: str) -> Path:
    """A file in the folder of another or below it, which no link leads out of."""
    folder = path.parent
    if isinstance(name, str) and name not in ("", ".") and "\0" not in name:
        relative, found = Path(name), folder / name
        with contextlib.suppress(OSError, RuntimeError):  # links that lead in a circle
            within = found.resolve().is_relative_to(folder.resolve())
            if within and not relative.anchor and ".." not in relative.parts:
                return found
    raise ValueError(
        f"{what}: expected the name of a file in the same folder or below, got {name!r}"
    )


def resolve_sibling(path: Path, name: object) -> Path:
    """A file in the same folder: a description from a stranger must not point elsewhere."""
    if (
        not isinstance(name, str)
        or Path(name).name != name
        or name in ("", ".", "..")
        or "\0" in name
    ):
        raise ValueError(f"maps: expected the name of a file in the same folder, got {name!r}")
    return path.parent / name
