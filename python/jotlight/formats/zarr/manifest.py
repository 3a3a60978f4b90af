"""The manifest of a zarr folder that jotlight wrote: the files that it must contain.

Each chunk ends in its CRC-32C, which the zarr library checks. Files of many chunks, called shards,
end in an index with such a checksum. The manifest lists these checksums, which reveals missing and
exchanged chunks. It also lists the SHA-256 of all metadata.
"""

import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jotlight.formats.files.checksums import check_file, check_seal, file_checksum, seal
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.remote_files import open_binary
from jotlight.formats.files.safe_paths import check_inside
from jotlight.formats.zarr.shards import (
    CHECKSUM_BYTES,
    chunks_per_shard,
    is_shard,
    parts_of_shard,
    stored_checksums,
)

METADATA_FILES = ("zarr.json", ".zarray", ".zgroup", ".zattrs")
"""Names of the files that describe an array or a group, in versions 3 and 2 of zarr."""

MAX_METADATA_BYTES = 1 << 22
"""Maximum size in bytes of such a file."""

BITS_ARRAY = "bits"
"""Name of the array of bits in a group."""

MANIFEST = "jotlight.json"
"""Name of the manifest. It lies beside the chunks of the bits or counts.

Beside the metadata of a group, the zarr library would warn about a file that it does not know.
"""

MANIFESTS = (MANIFEST, f"{BITS_ARRAY}/{MANIFEST}")
"""Names under which a manifest is found in a zarr folder: beside an array, or in a group."""

_FORMAT, _VERSION = "jotlight zarr", 1

_MAX_MANIFEST_BYTES = 1 << 27
"""Maximum size of the manifest in bytes. It has about 40 bytes per chunk, enough for 20 TB."""


def write_manifest(folder: Path, array: Path) -> None:
    """Write the manifest of a complete zarr folder into the folder of one of its arrays."""
    metadata, chunks = {}, {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        if path.name in METADATA_FILES:
            metadata[name] = file_checksum(path)
        else:
            chunks[name] = stored_checksums(path, chunks_per_shard(_metadata_of(path, folder)))
    content = {"format": _FORMAT, "version": _VERSION, "metadata": metadata, "chunks": chunks}
    (array / MANIFEST).write_text(seal(content), encoding="utf-8")


def read_manifest(folder: Path, files: Mapping[str, FileReader]) -> dict[str, str] | None:
    """Return the checksums of the chunks by name, or None if there is no manifest.

    Parameters
    ----------
    folder : path
        The root of a zarr folder.
    files : mapping
        All files in the folder by name.

    Raises
    ------
    ValueError
        When the manifest is damaged, a file that it lists is missing, or metadata have changed.
        Files that it does not list are ignored, except for metadata: they change the content.
    """
    name = next((name for name in MANIFESTS if name in files), None)
    if name is None:
        return None
    path = check_inside(folder / name, folder)
    if files[name].size > _MAX_MANIFEST_BYTES:
        raise ValueError(f"{path}: expected at most {_MAX_MANIFEST_BYTES} bytes; it is damaged")
    try:
        text = path.read_bytes().decode()
        check_seal(text, str(path), editable=False)
        content = json.loads(text)
        metadata, chunks = _parse(content)
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: the list of the files is damaged ({error})") from error
    missing = [name for name in (*metadata, *chunks) if name not in files]
    if missing:
        raise ValueError(
            f"{folder}: {len(missing)} of its {len(metadata) + len(chunks)} files are missing, "
            f"such as {missing[0]}; open the whole zarr folder, or restore them from a copy"
        )
    for name in files:
        if name.rpartition("/")[2] in METADATA_FILES and name not in metadata:
            raise ValueError(f"{folder / name}: is not listed in {MANIFEST}; move it elsewhere")
    for name, checksum in metadata.items():
        check_file(folder / name, checksum)
    return chunks


def verify_chunks(folder: Path, checksums: Mapping[str, str]) -> int:
    """Return the number of chunks after comparing each of them with its checksum.

    Raises
    ------
    ValueError
        When a chunk is damaged.
    """
    import google_crc32c

    for name, checksum in checksums.items():
        path = folder / name
        with open_binary(path) as file:
            content = file.read()
        parts = [content]
        with contextlib.suppress(ValueError):  # a damaged index differs from its checksum
            if is_shard(checksum):
                parts = parts_of_shard(content, chunks_per_shard(_metadata_of(path, folder)))
        computed, stored = "", ""
        for part in parts:
            computed += google_crc32c.value(part[:-CHECKSUM_BYTES]).to_bytes(4, "little").hex()
            stored += part[-CHECKSUM_BYTES:].hex()
        if not computed == stored == checksum:
            raise ValueError(f"{path}: is damaged; restore it from a copy")
    return len(checksums)


def _metadata_of(chunk: Path, folder: Path) -> Path:
    """Return the file that describes the array of a chunk."""
    parents = [path for path in chunk.parents if path.is_relative_to(folder)]
    return next(path / "zarr.json" for path in parents if (path / "zarr.json").is_file())


def _parse(content: Any) -> tuple[dict[str, str], dict[str, str]]:
    if content["format"] != _FORMAT or content["version"] != _VERSION:
        raise ValueError(f"expected format {_FORMAT!r}, version {_VERSION}")
    unknown = content.keys() - {"checksum", "format", "version", "metadata", "chunks"}
    if unknown:
        raise ValueError(f"got unknown entries {', '.join(sorted(unknown))}")
    metadata, chunks = content["metadata"], content["chunks"]
    if not isinstance(metadata, dict) or not isinstance(chunks, dict):
        raise ValueError("expected metadata and chunks by name")
    return metadata, chunks
