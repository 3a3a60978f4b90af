"""Checksums of the files that jotlight writes: SHA-256, so that other tools can compute them too.

JSON files contain the checksums of other files, and their own (`seal`). Binary files end with their
own checksum if their format ignores bytes at the end (`append_checksum`).
"""

import hashlib
import io
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from jotlight.formats.files.remote_files import open_binary, remote_file

_READ_BYTES = 1 << 23
"""Number of bytes of a remote file that are read at a time."""

_KEY = "checksum"
"""Key of the checksum in sealed JSON, which is JSON with a checksum of itself."""

_MARK = f'"{_KEY}": "sha256:'
"""Text that identifies sealed JSON, also if the rest of it is damaged."""

_VALUE = re.compile(rf'(?<=^{{\n  {re.escape(_MARK)})[0-9a-f]{{64}}(?=",\n)')
"""Pattern of the checksum, which is alone in the first line of the object.

So users can delete this line.
"""

_PLACEHOLDER = "0" * 64
"""Digits that stand for the checksum while it is computed."""

END_PLACEHOLDER = b"sha256:" + _PLACEHOLDER.encode()
"""End of a file before :func:`append_checksum` replaces the digits."""

_END = re.compile(rb"sha256:(.{64})", re.DOTALL)
"""Pattern of the end of a file that has an appended checksum, which may be damaged."""


def file_checksum(path: Path, start: int = 0) -> str:
    """Return the SHA-256 of a file, as 64 hexadecimal digits, as `sha256sum` prints it.

    Parameters
    ----------
    path : path
        A file.
    start : int
        Number of bytes to skip at the beginning of the file.

    Raises
    ------
    OSError
        When the file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.bin"
    >>> _ = path.write_bytes(b"abc")
    >>> file_checksum(path)[:16]
    'ba7816bf8f01cfea'
    """
    if (remote := remote_file(path)) is not None:
        digest = hashlib.sha256()
        for first in range(start, remote.size, _READ_BYTES):
            digest.update(remote.read(first, min(first + _READ_BYTES, remote.size)))
        return digest.hexdigest()
    with path.open("rb") as file:
        file.seek(start)
        return hashlib.file_digest(file, "sha256").hexdigest()


class HashingWriter(io.BufferedIOBase):
    """A file that computes its checksum while it is written from beginning to end.

    Examples
    --------
    >>> writer = HashingWriter(io.BytesIO())
    >>> writer.write(b"abc"), writer.checksum()[:16]
    (3, 'ba7816bf8f01cfea')
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self._hash = file, hashlib.sha256()

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, data: Any) -> int:
        """Write bytes, and return their number."""
        self._hash.update(data)
        return self._file.write(data)

    def checksum(self) -> str:
        """Return the SHA-256 of everything that was written."""
        return self._hash.hexdigest()


def check_file(path: Path, checksum: object) -> None:
    """Raise ValueError unless a file has this SHA-256.

    Raises
    ------
    OSError
        When the file cannot be read.
    """
    if file_checksum(path) != checksum:
        raise differs_error(path)


def differs_error(path: Path) -> ValueError:
    """Return the error for a file that differs from its checksum."""
    return ValueError(
        f"{path}: is damaged or was changed: its SHA-256 is not the one that was stored when "
        "jotlight wrote it; restore it from a copy"
    )


def missing_error(path: Path) -> ValueError:
    """Return the error for a file by jotlight that must end with its checksum, but does not."""
    return ValueError(
        f"{path}: expected a checksum at its end, where jotlight writes it, but it is damaged or "
        "another program removed it; restore the file from a copy"
    )


def append_checksum(file: IO[bytes], *, placeholder: bool = True) -> None:
    """Append the checksum of the whole content to a file that is open for reading and writing.

    Parameters
    ----------
    file : binary file
    placeholder : bool
        Whether to append :data:`END_PLACEHOLDER` first. Otherwise the file already ends with it.
    """
    file.seek(0, os.SEEK_END)
    if placeholder:
        file.write(END_PLACEHOLDER)
    covered = file.tell() - len(_PLACEHOLDER)
    checksum = _hash_beginning(file, covered)
    file.seek(covered)
    file.write(checksum.encode())


def check_appended(path: Path) -> bool:
    """Return whether a file ends with the checksum of its content. Raise ValueError if it differs.

    Raises
    ------
    OSError
        When the file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.bin"
    >>> _ = path.write_bytes(b"abc")
    >>> check_appended(path)
    False
    >>> with path.open("r+b") as file:
    ...     append_checksum(file)
    >>> check_appended(path)
    True
    """
    covered = path.stat().st_size - len(_PLACEHOLDER)
    with open_binary(path) as file:
        file.seek(max(0, path.stat().st_size - len(END_PLACEHOLDER)))
        found = _END.fullmatch(file.read())
        if found is None:
            return False
        if _hash_beginning(file, covered).encode() != found[1]:
            raise differs_error(path)
    return True


def check_opened(path: Path) -> bool:
    """Return :func:`check_appended` of a file that is opened.

    At a URL, the content is not compared, because it would be read as a whole. Conversions do.
    """
    if (remote := remote_file(path)) is None:
        return check_appended(path)
    size = remote.size
    return _END.fullmatch(remote.read(max(0, size - len(END_PLACEHOLDER)), size)) is not None


def _hash_beginning(file: IO[bytes], size: int) -> str:
    """Return the SHA-256 of the first `size` bytes of a file."""
    file.seek(0)
    hash_ = hashlib.sha256()
    while size and (chunk := file.read(min(1 << 20, size))):
        hash_.update(chunk)
        size -= len(chunk)
    return hash_.hexdigest()


def seal(content: Mapping[str, Any]) -> str:
    """Return JSON text of an object, which must not be empty. The text begins with its checksum.

    Examples
    --------
    >>> text = seal({"width": 13})
    >>> list(json.loads(text))
    ['checksum', 'width']
    >>> check_seal(text, "a.json")
    """
    text = json.dumps({_KEY: f"sha256:{_PLACEHOLDER}", **content}, indent=2) + "\n"
    return _VALUE.sub(_text_checksum(text), text)


def is_sealed(text: str) -> bool:
    """Return whether a text is sealed JSON, also if it is damaged.

    An empty text, or one that ends before the checksum, also counts: a copy that was interrupted
    leaves such files.

    Examples
    --------
    >>> is_sealed(seal({"width": 13})), is_sealed('{"width": 13}')
    (True, False)
    """
    beginning = text.rstrip("\0")  # some disks leave zeros after a power failure
    return _MARK in text or f"{{\n  {_MARK}".startswith(beginning)


def check_seal(text: str, name: str, *, editable: bool = True) -> None:
    """Raise ValueError when sealed JSON has changed since :func:`seal` returned it.

    Parameters
    ----------
    text : str
        Sealed JSON.
    name : str
        The file, for messages.
    editable : bool
        Whether users may change the file, after which they delete its checksum.

    Examples
    --------
    >>> check_seal(seal({"width": 13}).replace("13", "15"), "a.json")
    Traceback (most recent call last):
    ...
    ValueError: a.json: is damaged or was changed; if you changed it, delete its line "checksum"
    """
    found = _VALUE.search(text)
    blank = _VALUE.sub(_PLACEHOLDER, text)
    if found is None or found[0] != _text_checksum(blank):
        remedy = f'if you changed it, delete its line "{_KEY}"' if editable else "restore a copy"
        raise ValueError(f"{name}: is damaged or was changed; {remedy}")


def _text_checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
