"""What the files of an output contain, apart from the times at which they were made."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from safetensors.numpy import load

from damage.processes import is_hidden

Content = Mapping[str, str]
"""Digests of the contents of all visible files, by their relative paths."""

CHECKPOINT = ".checkpoint.safetensors"
"""End of the name of a checkpoint. A stopped run leaves it so that the run can continue."""


def read_outputs(folder: Path) -> Content:
    """Return what all visible files in a folder contain.

    Raises
    ------
    Exception
        When a network is damaged. Other files are compared byte by byte.
    """
    return {
        name: _digest(folder / name)
        for name in sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
        if not is_hidden(name)
    }


def _digest(path: Path) -> str:
    if path.is_dir():
        return "folder"
    content = path.read_bytes()
    if path.suffix == ".safetensors":
        # The metadata hold the time of the run.
        arrays = load(content)
        content = b"".join(name.encode() + arrays[name].tobytes() for name in sorted(arrays))
    if path.suffix == ".json" and "parts" in path.parts:
        content = json.dumps(json.loads(content)["rows"]).encode()
    if path.name in ("report.html", "reproduction.md", "run.csv"):
        content = str(len(content.split())).encode()
    return hashlib.sha256(content).hexdigest()
