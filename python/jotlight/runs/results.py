"""Results of one unit, with a record beside them: images, and copies of captures."""

import os
from collections.abc import Iterable
from pathlib import Path

from jotlight.errors import counted
from jotlight.files import create_parent
from jotlight.output_links import follow_link
from jotlight.runs.records import Record, check_same_run, read_json

_ADVICE = "all workers must see the folder of the outputs under the same path"


class RecordedResult:
    """A file or a folder with a record beside it, which one unit makes.

    The record states what the result is made of, and its size. It appears before the result, which
    appears whole. So a record without a result says nothing, and a result of the stated size is
    complete.
    """

    output: Path
    run: Record
    """What the result is made of, and how."""

    @property
    def record(self) -> Path:
        """The record beside the result."""
        raise NotImplementedError

    @property
    def beside(self) -> Iterable[Path]:
        """Further files beside the result that belong to it."""
        return ()

    @property
    def is_single(self) -> bool:
        """True: one unit makes the result."""
        return True

    def is_complete(self) -> bool:
        """Return whether the result exists, and has the size that its record states.

        Raises
        ------
        AnotherRunError
            When the result is that of another run, or the record is another file.
        ValueError
            When the result has another size, for example after an interrupted copy.
        """
        exists = self.output.exists()  # before the record is read, which a process writes first
        stored: Record = {}
        if self.record.exists():
            stored = read_json(self.record)
            if not isinstance(stored.get("run"), dict):
                check_same_run(self.record, None, self.run)
        if not exists:
            return False
        check_same_run(self.output, stored.get("run"), self.run, self.record)
        if "output" not in stored:  # the process was killed before it completed the record
            return False
        found = measure(self.output, self.beside)
        if stored["output"] != found:
            raise ValueError(
                f"{self.output}: expected {_size_text(stored['output'])}, which its record states, "
                f"got {_size_text(found)}; restore it from a copy, or delete it to make it again"
            )
        return True

    def refuse_complete(self) -> None:
        """Raise FileExistsError if another process has completed the result meanwhile."""
        if self.is_complete():  # the run reports this error only if it does not find the result
            raise FileExistsError(
                f"{self.output}: a worker finds it complete, but this machine does not; {_ADVICE}"
            )

    def prepare(self) -> list[int]:
        """Create the folder that will contain the result, and return the only unit."""
        create_parent(self.output)
        return [0]

    def finish(self) -> None:
        """Raise FileNotFoundError unless the result of the worker is complete on this machine."""
        # When a folder is opened, the system asks a network disk for its present content.
        os.scandir(follow_link(self.output).parent).close()
        if not self.is_complete():
            raise FileNotFoundError(
                f"{self.output}: a worker has written it, but it is not on this machine; {_ADVICE}"
            )


def measure(output: Path, beside: Iterable[Path] = ()) -> Record:
    """Return the number of the files of a result, and of their bytes.

    Hidden files and folders, which other programs add to folders, are left out.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("a", "b", ".hidden"):
    ...     _ = (folder / name).write_bytes(bytes(10))
    >>> measure(folder), measure(folder / "a")
    ({'files': 2, 'bytes': 20}, {'files': 1, 'bytes': 10})
    """
    found = ((path, path.relative_to(output).parts) for path in output.rglob("*"))
    inside = (path for path, parts in found if not any(part.startswith(".") for part in parts))
    files = [path for path in (output, *inside, *beside) if path.is_file()]
    return {"files": len(files), "bytes": sum(path.stat().st_size for path in files)}


def _size_text(size: Record) -> str:
    """Return a size of :func:`measure`, which a damaged record may state, as a text."""
    try:
        return f"{size['bytes']} bytes in {counted(size['files'], 'file')}"
    except (KeyError, TypeError):
        return repr(size)
