"""The captures of a run whose parts separate processes compute.

The first part of a run writes the names of its captures beside the results, in a hidden folder
`.captures-…`. All parts divide these, so captures that appear or vanish meanwhile change nothing,
and `jotlight gather` knows which results are missing.
"""

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from jotlight.files import atomic_folder, create_parent, write_file
from jotlight.formats.opening.locations import is_url
from jotlight.runs.names import NAME_PLACE, name_outputs
from jotlight.runs.records import Record, read_json

_FOLDER, _FILE = ".captures-", "captures.json"

_MAX_BYTES = 1 << 28
"""Maximum size of a file of names."""


@dataclasses.dataclass(frozen=True)
class SharedRun:
    """The captures of a run in parts, and the pattern of its results.

    Examples
    --------
    >>> run = SharedRun(Path("v"), "{name}.zarr", ["a", "b"])
    >>> [path.as_posix() for path in run.outputs()]
    ['v/a.zarr', 'v/b.zarr']
    """

    folder: Path
    """The folder of all results."""
    output: str
    """The results in this folder, with a place for the names of captures."""
    captures: list[str]
    """The names of captures."""

    @classmethod
    def of(cls, output: Path, names: Sequence[str]) -> "SharedRun":
        """Return the run with the pattern of its outputs, and the names of its captures."""
        folder = output.parent
        while NAME_PLACE in folder.as_posix():
            folder = folder.parent
        return cls(folder, output.relative_to(folder).as_posix(), list(names))

    def outputs(self) -> list[Path]:
        """Return the path of each result."""
        return name_outputs(self.folder / self.output, self.captures)

    def join(self, patterns: Sequence[str]) -> tuple["SharedRun", Path]:
        """Return the run as its first part has found it, and the folder that states it.

        Parameters
        ----------
        patterns : sequence of str
            The captures as the user names them. Other ones are those of another run.

        Raises
        ------
        OSError, ValueError
            When the folder cannot be written, or is damaged.
        """
        stated = [each if is_url(each) else str(Path(each).absolute()) for each in patterns]
        key = hashlib.sha256(json.dumps([stated, self.output]).encode()).hexdigest()[:12]
        folder = self.folder / f"{_FOLDER}{key}"
        create_parent(folder)
        if not folder.exists():
            content = {"output": self.output, "captures": self.captures}
            try:
                with atomic_folder(folder) as temporary:
                    write_file(temporary / _FILE, json.dumps(content, indent=1))
            except OSError:
                if not folder.exists():  # otherwise, another part was faster
                    raise
        return read_run(folder), folder


def read_run(folder: Path) -> SharedRun:
    """Return the run that a folder `.captures-…` states.

    Raises
    ------
    OSError, ValueError
        When the folder is damaged.
    """
    content: Record = read_json(folder / _FILE, _MAX_BYTES)
    output, captures = content.get("output"), content.get("captures")
    if isinstance(output, str) and isinstance(captures, list):
        names = [each for each in captures if isinstance(each, str)]
        if 0 < len(names) == len(captures):
            return SharedRun(folder.parent, output, names)
    raise ValueError(f"{folder}: is damaged; delete it, and run all parts again")


def find_runs(folders: Iterable[Path]) -> list[Path]:
    """Return the folders `.captures-…` in some folders and below."""
    found = (path for folder in folders for path in sorted(folder.rglob(f"{_FOLDER}*")))
    return list(dict.fromkeys(path for path in found if (path / _FILE).is_file()))


def check_results(runs: Iterable[Path]) -> tuple[int, list[Path]]:
    """Return the number of results of some runs, and those that do not exist.

    If a run has all of its results, its folder is deleted, so that it may begin with new captures.

    Raises
    ------
    OSError, ValueError
        When a folder is damaged, or cannot be deleted.
    """
    number, missing = 0, list[Path]()
    for folder in runs:
        outputs = read_run(folder).outputs()
        absent = [path for path in outputs if not path.exists()]
        number += len(outputs)
        missing += absent
        if not absent:
            shutil.rmtree(folder)
    return number, missing
