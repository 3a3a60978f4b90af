"""A limit on the size of the array that a file claims, checked before memory is allocated."""

_MAX_EXPANSION = 1100
"""Maximum ratio of decompressed to compressed bytes. That of DEFLATE is below 1033."""

_FREE_BYTES = 1 << 24
"""Number of bytes that even the smallest file may claim."""


def check_claimed_size(name: str, claimed: int, file_bytes: int) -> None:
    """Raise ValueError when a file of `file_bytes` bytes cannot hold an array of `claimed` bytes.

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
