"""Arrays with metadata in `.safetensors` files: networks, checkpoints and calibrations."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy.typing as npt

from jotlight.files import atomic_write

Tensors = dict[str, npt.NDArray[Any]]


def write_tensors(
    path: str | os.PathLike[str], tensors: Tensors, metadata: Mapping[str, str]
) -> None:
    """Write a file whose bytes depend on what is in it, and on nothing else."""
    from safetensors.numpy import save

    content = save(tensors, dict(metadata))
    # The library puts the entries of its header, which is JSON, in an order that changes.
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8:end]), sort_keys=True).encode()
    header += b" " * (-len(header) % 8)
    with atomic_write(path) as temporary:
        temporary.write_bytes(len(header).to_bytes(8, "little") + header + content[end:])


def stored_format(path: Path) -> str:
    """The format that a file says it has; empty where it says nothing or cannot be read."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="numpy") as file:
            return str((file.metadata() or {}).get("format", ""))
    except (SafetensorError, OSError):
        return ""


def read_tensors(path: Path, format_: str, version: str) -> tuple[Tensors, dict[str, str]]:
    """Read a file of one of our formats, without running anything in it.

    Raises
    ------
    ValueError
        When it is damaged, or of another format or version.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, TypeError, AttributeError) as error:
        # The latter two for tensors of a type that NumPy lacks.
        raise ValueError(
            f"{path}: expected a safetensors file, which this is not or no more ({error})"
        ) from error
    kind = metadata.get("format", "")
    if kind != format_:
        kind = kind if kind.startswith("jotlight") else "a safetensors file of another kind"
        raise ValueError(f"{path}: expected a {format_}, got {kind}")
    if metadata.get("version") != version:
        raise ValueError(
            f"{path}: expected format version {version}, got {metadata.get('version')}; "
            "a newer jotlight may read it"
        )
    return tensors, metadata
