"""Descriptions: a `.json` next to a `.npy` or `.npy.gz` with its metadata and its checksum.

The description of bits states their width, sensor, and provenance. That of readings of several bits
states their sensor and provenance. The maps of the sensor are separate `.npy` files, which the
description names. The description of counts is their label.
"""

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any, cast

import numpy.typing as npt

from jotlight.errors import warn
from jotlight.files import atomic_write_together, write_file
from jotlight.formats.files.checksums import (
    HashingWriter,
    check_file,
    check_seal,
    differs_error,
    is_sealed,
    seal,
)
from jotlight.formats.files.safe_paths import check_inside, resolve_below
from jotlight.formats.frames.labels import BITS, COUNTS, MAX_LABEL_BYTES, READINGS, VERSION
from jotlight.formats.npy.arrays import read_npy, write_npy
from jotlight.formats.npy.compressed import open_gzip
from jotlight.output_files import open_output
from jotlight.output_links import follow_link
from jotlight.sensing.parameters.maps import MAPS
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor

_KEYS = {
    BITS: {"width", "sensor", "maps"},
    COUNTS: {"trials"},
    READINGS: {"sensor", "maps"},
}
"""Keys of a description for each format, in addition to the common keys."""

_COMMON_KEYS = {"format", "version", "provenance", "shape", "sha256"}
"""Keys of the descriptions of all formats."""


@dataclasses.dataclass(frozen=True)
class Description:
    """A description that jotlight wrote, which is complete and unchanged."""

    path: Path
    text: str
    content: dict[str, Any]

    @property
    def format(self) -> str:
        """Return what it describes: :data:`BITS`, :data:`COUNTS`, or :data:`READINGS`."""
        return str(self.content["format"])

    def map_files(self) -> dict[str, tuple[Path, object]]:
        """Return the path and the checksum of each map. A missing checksum is None."""
        maps = self.content.get("maps") or {}
        if not isinstance(maps, dict) or not maps.keys() <= set(MAPS):
            raise ValueError(
                f"{self.path}: maps: expected files for {' and '.join(MAPS)}, got {maps!r}"
            )
        files = {}
        for name, entry in maps.items():
            if not isinstance(entry, dict) or not {"file"} <= entry.keys() <= {"file", "sha256"}:
                raise ValueError(
                    f"{self.path}: maps: expected an object with file and sha256, got {entry!r}"
                )
            try:
                file = resolve_below(self.path, entry["file"], "maps")
            except ValueError as error:
                raise ValueError(f"{self.path}: {error}") from error
            files[name] = file, entry.get("sha256")
        return files


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
    return descriptions.union(*map(_maps_written_with, descriptions))


def _maps_written_with(description: Path) -> set[Path]:
    """Return the paths of the maps that jotlight wrote together with a description.

    The description may name further maps. If it is damaged, the result is empty.
    """
    try:
        own = _read_own_description(description) if description.is_file() else None
        files = {} if own is None else own.map_files()
    except ValueError:
        files = {}
    return {file for name, (file, _) in files.items() if file == map_path(description, name)}


def _read_own_description(path: Path) -> Description | None:
    """Return a description, or None when jotlight did not write the file.

    Raises
    ------
    ValueError
        When jotlight wrote the file, but it is damaged or was changed.
    """
    with path.open("rb") as file:
        text = file.read(MAX_LABEL_BYTES + 1).decode("utf-8", "replace")
    if is_sealed(text):
        check_seal(text, str(path))
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.get("format") not in list(_KEYS):
        # jotlight wrote this text. To ignore it because it is damaged would change the capture.
        if is_sealed(text) or any(f'"format": "{format_}"' in text for format_ in _KEYS):
            raise ValueError(
                f"{path}: expected a complete description by jotlight of at most "
                f"{MAX_LABEL_BYTES} bytes, but it is damaged; restore it from a copy"
            )
        return None
    if is_sealed(text):
        del content["checksum"]
    unknown = sorted(content.keys() - _COMMON_KEYS - _KEYS[content["format"]])
    if content.get("version") != VERSION or unknown:
        got = f"unknown keys {', '.join(unknown)}" if unknown else repr(content.get("version"))
        raise ValueError(f"{path}: expected a description of version {VERSION}, got {got}")
    return Description(path, text, content)


def find_description(cube: Path) -> Description | None:
    """Return the description of a cube, or None if there is no such file by jotlight.

    Raises
    ------
    ValueError
        When jotlight wrote the file, but it is damaged or was changed.
    """
    path = _existing_description(cube)
    if cube.is_symlink() and not path.is_file():
        path = _existing_description(cube := cube.resolve())
    if not path.is_file():
        return None
    target = path.resolve()
    if path.is_symlink() and cube.is_symlink() and target.parent == cube.resolve().parent:
        path = target  # the caller passed a link to the cube, and this one belongs to it
    else:
        check_inside(path, cube.parent)
    description = _read_own_description(path)
    if description is None:
        warn(f"{path} does not describe bits or counts of jotlight and is not used")
    return description


def check_shape(description: Description, cube: Path, shape: tuple[int, ...]) -> None:
    """Raise ValueError when a description belongs to a cube of another shape."""
    stated = description.content.get("shape", list(shape))
    if stated != list(shape):
        raise ValueError(
            f"{description.path}: describes a cube of shape {stated}, but {cube.name} has "
            f"{list(shape)}; it belongs to another cube, so move it away"
        )


def check_data(description: Description, cube: Path) -> bool:
    """Return whether a cube has a checksum. Raise ValueError when the cube differs from it."""
    checksum = description.content.get("sha256")
    if checksum is None:
        return False
    own = {description_path(cube), description_path(cube.resolve())}
    if cube.suffix.lower() == ".gz" and description.path not in own:
        # The checksum is that of the uncompressed cube, which another tool has compressed.
        with open_gzip(cube) as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != checksum:
                raise differs_error(cube)
    else:
        check_file(cube, checksum)
    return True


def verify_cube(cube: Path) -> int:
    """Return how many files match their checksums: a cube, its description, and its maps.

    Raises
    ------
    OSError
        When a file cannot be read.
    ValueError
        When a file differs.
    """
    description = find_description(cube)
    if description is None:
        return 0
    checked = int(is_sealed(description.text)) + check_data(description, cube)
    return checked + sum(_check_map(*file) for file in description.map_files().values())


def _check_map(path: Path, checksum: object) -> bool:
    if checksum is not None:
        check_file(path, checksum)
    return checksum is not None


def read_bits_description(
    description: Description,
) -> tuple[int, Sensor | None, Provenance | None]:
    """Return the width, the sensor, and the provenance from a description of bits.

    Raises
    ------
    FileNotFoundError
        When a map is missing.
    ValueError
        When the description is invalid, or a map differs from its checksum.
    """
    width = description.content.get("width")
    if type(width) is not int or width < 1:
        raise ValueError(f"{description.path}: expected a width in jots, got width {width!r}")
    return width, *read_sensor(description)


def read_sensor(description: Description) -> tuple[Sensor | None, Provenance | None]:
    """Return the sensor and the provenance from a description of bits or readings.

    Raises
    ------
    FileNotFoundError
        When a map is missing.
    ValueError
        When the description is invalid, or a map differs from its checksum.
    """
    path, content = description.path, description.content
    origin = content.get("provenance")
    try:
        provenance = None if origin is None else Provenance.from_json(origin)
        if content.get("sensor") is None:
            return None, provenance
        maps = {}
        for name, (file, checksum) in description.map_files().items():
            _check_map(file, checksum)
            maps[name] = read_npy(file)
        return Sensor.from_parts(content["sensor"], maps), provenance
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{path}: {error}") from error
    except (TypeError, ValueError) as error:
        raise ValueError(str(error) if str(path) in str(error) else f"{path}: {error}") from error


@contextlib.contextmanager
def write_described(
    path: Path, content: Mapping[str, Any], maps: Mapping[str, npt.NDArray[Any]]
) -> Iterator[IO[bytes]]:
    """Yield a file to which a cube is written from beginning to end.

    The cube, its description, and its maps appear when the block ends. The maps of an overwritten
    cube are deleted.

    Parameters
    ----------
    path : path
        The path of the cube.
    content : mapping
        The description, without checksums and the files of maps.
    maps : mapping
        The maps of the sensor by name.

    Raises
    ------
    FileExistsError
        When a file that jotlight did not write for this cube would be overwritten.
    """
    description = description_path(path := follow_link(path))
    map_paths = {name: map_path(description, name) for name in maps}
    replaced_maps = _maps_written_with(description)
    _refuse_foreign_files(path, description, set(map_paths.values()) - replaced_maps)
    content = dict(content)
    # The cube appears last.
    with atomic_write_together([path], [description, *map_paths.values()]) as temporaries:
        cube, text, *map_files = temporaries
        for (name, map_), temporary in zip(maps.items(), map_files, strict=True):
            with _open_hashed(temporary) as file:
                write_npy(cast(IO[bytes], file), map_)
            entry = {"file": map_paths[name].name, "sha256": file.checksum()}
            content["maps"] = {**content.get("maps", {}), name: entry}
        with _open_hashed(cube) as file:
            yield cast(IO[bytes], file)
        write_file(text, seal({**content, "sha256": file.checksum()}))
    for stale in replaced_maps - set(map_paths.values()):
        stale.unlink(missing_ok=True)


@contextlib.contextmanager
def _open_hashed(path: Path) -> Iterator[HashingWriter]:
    with open_output(path) as file:
        yield HashingWriter(file)


def _refuse_foreign_files(cube: Path, description: Path, new_maps: set[Path]) -> None:
    """Raise FileExistsError if writing a cube would overwrite files of other origin."""
    foreign = sorted(path for path in new_maps if path.is_file())
    with contextlib.suppress(ValueError):  # a damaged description is replaced
        if description.is_file() and _read_own_description(description) is None:
            foreign.insert(0, description)
    if foreign:
        raise FileExistsError(
            f"{foreign[0]} would be overwritten by a file that belongs to {cube.name}, but "
            "jotlight did not write it for these data; move it, or choose another name"
        )
