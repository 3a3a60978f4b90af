"""Limits on the sizes that a file claims, checked before memory is allocated."""

_MAX_EXPANSION = 1100
"""Maximum ratio of decompressed to compressed bytes. That of DEFLATE is below 1033."""

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

    Parameters
    ----------
    name : str
        The file, for messages.
    claimed, file_bytes : int
        Sizes of the array and of the file in bytes.
    frame_bytes : int
        Size of one frame in bytes. A frame must fit in memory, but the array need not. A large
        frame that is compressed very well is refused: either it is empty, or somebody made it to
        exhaust the memory.
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
    if frame_bytes > _MAX_FRAME_EXPANSION * file_bytes + _FREE_FRAME_BYTES:
        raise ValueError(
            f"{name}: expected frames of at most {_FREE_FRAME_BYTES} bytes, or "
            f"{_MAX_FRAME_EXPANSION} times the {file_bytes} bytes of the file, got {frame_bytes}; "
            "if it is not damaged, store it uncompressed"
        )
    if whole and claimed > _MAX_FRAME_EXPANSION * file_bytes + _FREE_WHOLE_BYTES:
        raise ValueError(
            f"{name}: expected at most {_FREE_WHOLE_BYTES} bytes, or {_MAX_FRAME_EXPANSION} times "
            f"the {file_bytes} bytes of the file, got {claimed}, which are read as a whole; if it "
            "is not damaged, store it uncompressed or in parts"
        )
