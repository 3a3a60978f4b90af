"""The description of a photon cube: a `.json` next to it with its width, sensor, and provenance.

The maps of the sensor are `.npy` files of their own, which the description names.
"""

from pathlib import Path
from typing import Any

import numpy as np

from jotlight.errors import warn
from jotlight.formats.arrays import read_npy
from jotlight.formats.labels import BITS, MAX_LABEL_BYTES, VERSION, parse_label
from jotlight.formats.safe_paths import check_inside, resolve_below
from jotlight.sensing.maps import MAPS
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor


def description_path(cube: Path) -> Path:
    """Return the path to which the description of a cube is written.

    Examples
    --------
    >>> description_path(Path("a.npy")).name, description_path(Path("a.npy.gz")).name
    ('a.json', 'a.npy.gz.json')
    """
    if cube.suffix.lower() == ".gz":
        return cube.with_name(f"{cube.name}.json")
    return cube.with_suffix(".json")


def map_path(description: Path, name: str) -> Path:
    """Return the path to which a map of the sensor is written.

    Examples
    --------
    >>> map_path(Path("a.json"), "mask").name
    'a.mask.npy'
    """
    return description.with_suffix(f".{name}.npy")


def _existing_description(cube: Path) -> Path:
    """Return the path from which the description of a cube is read.

    When another tool compressed `a.npy` to `a.npy.gz`, the description is still `a.json`. It
    belongs to `a.npy` if that file exists.
    """
    own, decompressed = description_path(cube), cube.with_suffix("")
    if own.is_file() or cube.suffix.lower() != ".gz" or decompressed.exists():
        return own
    return description_path(decompressed)


def companion_files(cube: Path) -> set[Path]:
    """Return the files that belong to a cube: its description, and the maps that it names."""
    if cube.suffix.lower() not in (".npy", ".gz"):
        return set()
    descriptions = {description_path(cube), _existing_description(cube)}
    return descriptions.union(*map(maps_in_description, descriptions))


def maps_in_description(description: Path) -> set[Path]:
    """Return the paths of those maps named in a description that jotlight wrote with it."""
    content = (read_own_description(description) or {}) if description.is_file() else {}
    maps = content.get("maps")
    names = maps.values() if isinstance(maps, dict) else ()
    own = {map_path(description, name).name for name in MAPS}
    return {description.parent / name for name in names if name in own}


def read_own_description(path: Path) -> dict[str, Any] | None:
    """Return the content of a description, or None when jotlight did not write the file."""
    if path.stat().st_size > MAX_LABEL_BYTES:
        return None
    try:
        return parse_label(path.read_text(encoding="utf-8"), BITS)
    except ValueError:
        return None


def read_description(
    cube: Path, shape: tuple[int, ...]
) -> tuple[int | None, Sensor | None, Provenance | None]:
    """Return the width, the sensor, and the provenance from the description of a cube.

    All are None if there is no description, or if jotlight did not write that file.

    Parameters
    ----------
    cube : path
    shape : tuple of int
        Shape of the packed bits, with which the description must agree.

    Raises
    ------
    FileNotFoundError
        When a map is missing.
    ValueError
        When the description is invalid, or belongs to another cube.
    """
    path = _existing_description(cube)
    if not path.is_file():
        return None, None, None
    check_inside(path, cube.parent)
    content = read_own_description(path)
    if content is None:
        warn(f"{path} does not describe bits of jotlight and is not used")
        return None, None, None
    width = content.get("width")
    if content.get("version") != VERSION or not isinstance(width, int) or width < 1:
        raise ValueError(
            f"{path}: expected version {VERSION} and a width, got version "
            f"{content.get('version')!r} and width {width!r}"
        )
    if content.get("shape", list(shape)) != list(shape):
        raise ValueError(
            f"{path}: describes a cube of shape {content['shape']}, but {cube.name} has "
            f"{list(shape)}; it belongs to another cube, so move it away"
        )
    try:
        origin = content.get("provenance")
        provenance = None if origin is None else Provenance.from_json(origin)
        if content.get("sensor") is None:
            return width, None, provenance
        maps = _read_maps(cube, content.get("maps") or {})
        return width, Sensor.from_parts(content["sensor"], maps), provenance
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{path}: {error}") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _read_maps(cube: Path, names: Any) -> dict[str, np.ndarray]:
    if not isinstance(names, dict) or not names.keys() <= set(MAPS):
        raise ValueError(f"maps: expected files for {' and '.join(MAPS)}, got {names!r}")
    paths = {map_: resolve_below(cube, name, "maps") for map_, name in names.items()}
    return {map_: read_npy(path) for map_, path in paths.items()}
