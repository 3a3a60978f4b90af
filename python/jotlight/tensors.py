"""Arrays with metadata in `.safetensors` files: networks, checkpoints, and calibrations."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy.typing as npt

from jotlight.files import write_file

Tensors = dict[str, npt.NDArray[Any]]

_ZIP = b"PK\x03\x04"
"""First bytes of a zip archive."""


def write_tensors(
    path: str | os.PathLike[str], tensors: Tensors, metadata: Mapping[str, str]
) -> None:
    """Write a file whose bytes depend only on its contents."""
    from safetensors.numpy import save

    content = save(tensors, dict(metadata))
    # safetensors writes the entries of its JSON header in varying order, so they are sorted here.
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8:end]), sort_keys=True).encode()
    header += b" " * (-len(header) % 8)
    write_file(path, len(header).to_bytes(8, "little") + header + content[end:])


def stored_format(path: Path) -> str:
    """Return the format that a file states in its metadata, or "" if there is none."""
    try:
        return _read_file(path)[1].get("format", "")
    except (ValueError, OSError):
        return ""


def read_tensors(path: Path, format_: str, version: str) -> tuple[Tensors, dict[str, str]]:
    """Return the arrays and metadata of a file in one of jotlight's formats.

    Reading never runs code from the file.

    Raises
    ------
    ValueError
        When the file is damaged, or has another format or version.
    """
    tensors, metadata = _read_file(path)
    kind = metadata.get("format", "")
    if kind != format_:
        got = f"a {kind}" if kind.startswith("jotlight") else "a safetensors file of another kind"
        if kind.endswith("checkpoint"):
            got += (
                "; the run that wrote it continues with resume=True (--resume), and then returns a "
                "network"
            )
        raise ValueError(f"{path}: expected a {format_}, got {got}")
    if metadata.get("version") != version:
        raise ValueError(
            f"{path}: expected format version {version}, got {metadata.get('version')}; "
            "a newer jotlight may read it"
        )
    return tensors, metadata


def _read_file(path: Path) -> tuple[Tensors, dict[str, str]]:
    """Return the arrays and metadata of a safetensors file, which is not mapped into memory."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        with path.open("rb") as file:
            start = file.read(8)
            if start.startswith(_ZIP):
                raise ValueError(
                    "it is a zip archive, such as torch.save writes; save a network with "
                    "module.to_network().save(path)"
                )
            header_bytes = int.from_bytes(start, "little")
            # Without this check, a large file of another kind would be read completely.
            if header_bytes > os.fstat(file.fileno()).st_size:
                raise ValueError("its header is longer than the file")
            header = file.read(header_bytes)
            file.seek(0)
            tensors = load(file.read())
        metadata = json.loads(header).get("__metadata__") or {}
    except (SafetensorError, ValueError, KeyError) as error:
        # safetensors raises KeyError for element types that NumPy lacks.
        raise ValueError(
            f"{path}: expected a safetensors file, but it is another file or damaged ({error})"
        ) from error
    return tensors, metadata
