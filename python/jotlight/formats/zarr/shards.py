"""Shards: files of many chunks, each of which ends in its CRC-32C, as the index at the end does.

The manifest states the checksums of all chunks of a shard in the order of their positions, and then
that of the index.
"""

import json
import math
from pathlib import Path

import numpy as np

CHECKSUM_BYTES = 4
"""Size of the CRC-32C at the end of a chunk, and of the index of a shard."""

_EMPTY = 2**64 - 1
"""Position of a chunk that a shard does not contain."""

_DIGITS = 2 * CHECKSUM_BYTES


def chunks_per_shard(metadata: Path) -> int:
    """Return the number of chunks in a shard of the array that `zarr.json` describes; 1 without.

    Raises
    ------
    ValueError
        When the metadata are damaged.
    """
    try:
        content = json.loads(metadata.read_text(encoding="utf-8"))
        codecs = content.get("codecs", [])
        if [codec["name"] for codec in codecs] != ["sharding_indexed"]:
            return 1
        shard = content["chunk_grid"]["configuration"]["chunk_shape"]
        inner = codecs[0]["configuration"]["chunk_shape"]
        if not all(type(size) is int and size > 0 for size in (*shard, *inner)):
            raise TypeError("expected sizes")
        number: int = math.prod(shard) // math.prod(inner)
    except (AttributeError, LookupError, RecursionError, TypeError) as error:
        raise ValueError(f"{metadata}: the description of the array is damaged") from error
    return number


def index_bytes(chunks: int) -> int:
    """Return the number of bytes of the index of a shard, with its checksum."""
    return 16 * chunks + CHECKSUM_BYTES


def parse_index(index: bytes) -> list[tuple[int, int]]:
    """Return the position and the size of each chunk of a shard, sorted.

    Raises
    ------
    ValueError
        When a chunk is shorter than its checksum.
    """
    entries = np.frombuffer(index[:-CHECKSUM_BYTES], "<u8").reshape(-1, 2).tolist()
    found = sorted((start, size) for start, size in entries if start != _EMPTY)
    if any(size < CHECKSUM_BYTES for _, size in found):
        raise ValueError("the index of a shard is damaged")
    return found


def stored_checksums(path: Path, chunks: int) -> str:
    """Return the stored checksums of a file of `chunks` chunks, in hexadecimal digits."""
    with path.open("rb") as file:
        size = path.stat().st_size
        places = []
        if chunks > 1:
            file.seek(size - index_bytes(chunks))
            places = parse_index(file.read())
        ends = [start + length for start, length in places] + [size]
        checksums = []
        for end in ends:
            file.seek(end - CHECKSUM_BYTES)
            checksums.append(file.read(CHECKSUM_BYTES).hex())
    return "".join(checksums)


def is_shard(checksums: str) -> bool:
    """Return whether the checksums in the manifest are those of a shard."""
    return len(checksums) > _DIGITS


def check_index(index: bytes, checksums: str) -> dict[int, str]:
    """Return the checksum of each chunk of a shard by its position.

    Raises
    ------
    ValueError
        When the index is not the one of the manifest.
    """
    places = parse_index(index)
    stored = [checksums[at : at + _DIGITS] for at in range(0, len(checksums), _DIGITS)]
    if index[-CHECKSUM_BYTES:].hex() != stored[-1] or len(places) != len(stored) - 1:
        raise ValueError("the index of a shard is not the one that jotlight wrote")
    return {start: stored[number] for number, (start, _) in enumerate(places)}


def parts_of_shard(content: bytes, chunks: int) -> list[bytes]:
    """Return the chunks of a shard in the order of their positions, and its index.

    Raises
    ------
    ValueError
        When chunks overlap. Each of many chunks could then be as large as the file.
    """
    index = content[-index_bytes(chunks) :]
    places = parse_index(index)
    if sum(size for _, size in places) + len(index) > len(content):
        raise ValueError("the index of a shard is damaged")
    return [*(content[start : start + size] for start, size in places), index]
