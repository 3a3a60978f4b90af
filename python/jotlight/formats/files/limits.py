"""Limits on the sizes that a file claims, checked before memory is allocated."""

from jotlight.errors import warn

_MAX_EXPANSION = 1100
"""Maximum ratio of decompressed to compressed bytes of a DEFLATE stream. It is below 1033."""

_FREE_BYTES = 1 << 24
"""Number of bytes that even the smallest file may claim."""

_MAX_FRAME_EXPANSION = 100
"""Maximum ratio of the bytes of a frame to those of its file. A frame is in memory as a whole."""

_FREE_FRAME_BYTES = 1 << 26
"""Number of bytes that one frame of even the smallest file may have."""

_FREE_WHOLE_BYTES = 1 << 28
"""Number of bytes that an array of even the smallest file may have if it is read as a whole."""


def check_claimed_size(
    name: str, claimed: int, file_bytes: int, *, frame_bytes: int = 0, whole: bool = False
) -> None:
    """Raise ValueError when a file of `file_bytes` bytes cannot hold an array of `claimed` bytes.

    This function is for files that are compressed by DEFLATE or not at all. Other compressors, and
    chunks that were never written, have no such limit: see :func:`check_frame_size`.

    Parameters
    ----------
    name : str
        The file, for messages.
    claimed, file_bytes : int
        Sizes of the array and of the file in bytes.
    frame_bytes : int
        Size of one frame in bytes, for :func:`check_frame_size`.
    whole : bool
        Whether the array, too, must fit in memory, because it can only be read as a whole.

    Examples
    --------
    >>> check_claimed_size("a.npy.gz", claimed=10**9, file_bytes=10)
    Traceback (most recent call last):
    ...
    ValueError: a.npy.gz: claims 1000000000 bytes, more than a file of 10 can hold; it is damaged
    """
    if not 0 <= claimed <= _MAX_EXPANSION * file_bytes + _FREE_BYTES:
        raise ValueError(
            f"{name}: claims {claimed} bytes, more than a file of {file_bytes} can hold; "
            "it is damaged"
        )
    check_frame_size(name, frame_bytes, file_bytes)
    if whole and claimed > _MAX_FRAME_EXPANSION * file_bytes + _FREE_WHOLE_BYTES:
        raise ValueError(
            f"{name}: expected at most {_FREE_WHOLE_BYTES} bytes, or {_MAX_FRAME_EXPANSION} times "
            f"the {file_bytes} bytes of the file, got {claimed}, which are read as a whole; if it "
            "is not damaged, store it uncompressed or in parts"
        )


def check_frame_size(name: str, frame_bytes: int, file_bytes: int) -> None:
    """Raise ValueError when one frame is much larger than its file.

    A frame must fit in memory, but a stack of them need not. A large frame that is compressed very
    well is refused: either it is empty, or somebody made it to exhaust the memory.

    Parameters
    ----------
    name : str
        The file, for messages.
    frame_bytes, file_bytes : int
        Sizes of a frame and of the file in bytes.

    Examples
    --------
    >>> check_frame_size("a.h5", frame_bytes=10**9, file_bytes=10)
    Traceback (most recent call last):
    ...
    ValueError: a.h5: expected frames of at most 67108864 bytes, or 100 times the 10 bytes of the \
file, got 1000000000; if it is not damaged, store it uncompressed
    """
    if frame_bytes > _MAX_FRAME_EXPANSION * file_bytes + _FREE_FRAME_BYTES:
        raise ValueError(
            f"{name}: expected frames of at most {_FREE_FRAME_BYTES} bytes, or "
            f"{_MAX_FRAME_EXPANSION} times the {file_bytes} bytes of the file, got {frame_bytes}; "
            "if it is not damaged, store it uncompressed"
        )


def check_missing_chunks(
    name: str, found: int, total: int, max_missing: int, *, kind: str, reason: str
) -> None:
    """Warn if only some chunks of an array were stored.

    Parameters
    ----------
    name : str
        The array, for messages.
    found, total : int
        Number of the stored chunks, and of all.
    max_missing : int
        Maximum number of missing chunks for each stored one. Ten more are assumed to be stored.
    kind, reason : str
        What the chunks are called, and how missing ones are read and why they are missing.

    Raises
    ------
    ValueError
        When nearly all are missing. Reading such an array would take hours.

    Examples
    --------
    >>> check_missing_chunks("a", 0, 10**6, 1000, kind="chunks", reason="are read as 0")
    Traceback (most recent call last):
    ...
    ValueError: a: only 0 of its 1000000 chunks exist, and reading all would take hours; resize \
the array to the frames that were written; if all were written, the file is damaged
    """
    if total - found > max_missing * (found + 10):
        raise ValueError(
            f"{name}: only {found} of its {total} {kind} exist, and reading all would take hours; "
            "resize the array to the frames that were written; if all were written, the file is "
            "damaged"
        )
    if found < total:
        missing = f"{total - found} of its {total} {kind} are missing"
        warn(f"{name}: {missing} and {reason}, so check whether this is expected")
