"""An entry of the list of readers: what reads a family of files, and how examples are made."""

import dataclasses
import warnings
from collections.abc import Callable
from pathlib import Path

import jotlight as jl


@dataclasses.dataclass(frozen=True)
class Reader:
    """The function that reads a family of files, and functions that make valid examples."""

    opens: str
    """Name of the file or folder that is opened."""
    read: Callable[[Path], object]
    """Read the file at a path."""
    makers: tuple[Callable[[Path], object], ...]
    """Each makes an example at a path where nothing exists yet."""
    file: str = ""
    """Name of the file to damage, if it is not `opens` but in that folder or next to it."""
    wrap: Callable[[bytes], bytes] = bytes
    """Turn the bytes to damage into those of the file, for example by compressing them."""
    unwrap: Callable[[bytes], bytes] = bytes
    """Inverse of `wrap`."""
    json: bool = False
    """Whether the bytes to damage are JSON."""
    needs: str = "numpy"
    """Package that the reader requires."""
    read_isolated: Callable[[Path], object] | None = None
    """Read the file in a child process, where a C library reads it that a damaged file may
    crash."""

    def example(self, folder: Path, number: int = 0) -> tuple[Path, Path, bytes]:
        """Return an example that this function makes in a folder.

        Returns
        -------
        (path, path, bytes)
            The path to open, the file to damage, and its unwrapped bytes.
        """
        path = folder / self.opens
        self.makers[number](path)
        file = folder / (self.file or self.opens)
        return path, file, self.unwrap(file.read_bytes())


def read_or_refused(read, path):
    """Return what a reader returns, or None when it refuses the file with an error that names it.

    All other exceptions propagate.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read(path)
    except (OSError, ValueError, jl.MissingExtraError) as error:
        message = str(error)
    names = (path.name, path.parent.name, str(path))
    assert any(name in message for name in names), f"an error that names no file: {message}"
    return None
