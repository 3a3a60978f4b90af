"""Commands of jotlight in processes of their own, and the files that they leave."""

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

TIMEOUT = 300
"""Maximum time of a command in seconds."""

Tree = Mapping[str, str]
"""SHA-256 of the files below a folder by their relative paths; "folder" for folders."""


def environment(scratch: Path) -> dict[str, str]:
    """Return the environment of a command that writes its temporary files to a folder."""
    scratch.mkdir(parents=True, exist_ok=True)
    # Otherwise, Matplotlib would make a temporary folder in each run.
    cache = Path(os.environ.get("MPLCONFIGDIR", Path.home() / ".cache" / "matplotlib"))
    return {**os.environ, "TMPDIR": str(scratch), "MPLCONFIGDIR": str(cache), "COLUMNS": "400"}


def start(
    arguments: Sequence[str], folder: Path, scratch: Path, launcher: Sequence[str] = ()
) -> subprocess.Popen[str]:
    """Start a command of jotlight in a folder."""
    return subprocess.Popen(
        [sys.executable, *(launcher or ("-m", "jotlight")), *arguments],
        cwd=folder,
        env=environment(scratch),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )


def run(
    arguments: Sequence[str], folder: Path, scratch: Path, launcher: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    """Run a command of jotlight to its end."""
    process = start(arguments, folder, scratch, launcher)
    try:
        output, errors = process.communicate(timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        output, errors = process.communicate()
        errors += f"\nno end after {TIMEOUT} s"
    return subprocess.CompletedProcess(arguments, process.returncode, output, errors)


def read_tree(folder: Path) -> Tree:
    """Return the digests of all files and folders below a folder."""
    return {
        str(path.relative_to(folder)): (
            hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "folder"
        )
        for path in sorted(folder.rglob("*"))
    }


def is_hidden(name: str) -> bool:
    """Return whether a relative path lies in a hidden folder, or is hidden itself."""
    return any(part.startswith(".") for part in Path(name).parts)


def copy_tree(source: Path, target: Path) -> None:
    """Replace a folder by a copy of another one."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(source, target)
