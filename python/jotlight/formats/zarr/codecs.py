"""Codecs of zarr that decode a chunk into exactly as many bytes as the metadata imply.

A compressor of the zarr library decodes whatever a chunk contains. A chunk of some kilobytes can
thus take gigabytes of memory. The size of a decoded chunk follows from the metadata. So each
compressor is replaced by one that refuses any other size before it allocates memory.
"""

import asyncio
import bz2
import dataclasses
import lzma
import math
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import numcodecs
import numpy as np
import numpy.typing as npt
from numcodecs.abc import Codec
from zarr.abc.codec import BytesBytesCodec

# Importing it registers the codec.
import jotlight.formats.zarr.packbits  # noqa: F401

MAX_CHUNK_BYTES = 1 << 28
"""Maximum size of a decoded chunk in bytes. The library decodes a chunk as a whole."""

_MAX_SHARD_CHUNKS = 1 << 20
"""Maximum number of chunks in a shard."""

_STREAMS: dict[str, Callable[[], Any]] = {
    "zlib": zlib.decompressobj,
    "gzip": lambda: zlib.decompressobj(wbits=31),
    "bz2": bz2.BZ2Decompressor,
    "lzma": lambda: lzma.LZMADecompressor(memlimit=MAX_CHUNK_BYTES),
}
"""Compressors of the standard library, which can stop after a number of bytes."""

_ZSTD_SIZE_BYTES = {0: 0, 1: 2, 2: 4, 3: 8}
"""Number of bytes of the size in the header of a zstd frame, by two bits of its descriptor."""

_COMPRESSORS = {*_STREAMS, "zstd", "blosc", "lz4"}
"""All compressors that are accepted."""

_CHECKSUMS = {"crc32", "crc32c", "adler32"}
"""Codecs that append a checksum of four bytes."""

_SAME_SIZE = {"bytes", "transpose", "shuffle"}
"""Codecs that do not change the size of a chunk."""

_SAFE_NAMES = {
    *(*_COMPRESSORS, *_CHECKSUMS, *_SAME_SIZE, "delta", "packbits", "sharding_indexed"),
    *("regular", "default", "v2"),
}
"""Names that metadata may contain: codecs, chunk grids, and encodings of the names of chunks."""


def check_codec_names(metadata: Any) -> None:
    """Raise ValueError if metadata name a codec, at any depth, that is not known to be safe.

    Other codecs, such as pickle, can run code, or can take memory without limit.

    Examples
    --------
    >>> check_codec_names({"shape": [3], "filters": [{"id": "pickle"}]})
    Traceback (most recent call last):
    ...
    ValueError: codecs: expected only known safe codecs, got 'pickle'
    """
    if isinstance(metadata, dict):
        for name, value in metadata.items():
            if name in ("name", "id") and not (isinstance(value, str) and value in _SAFE_NAMES):
                raise ValueError(f"codecs: expected only known safe codecs, got {value!r}")
            if name != "attributes":
                check_codec_names(value)
    if isinstance(metadata, list):
        for value in metadata:
            check_codec_names(value)


def decode_exactly(codec: Codec, data: npt.ArrayLike, size: int) -> npt.NDArray[np.uint8]:
    """Return the `size` bytes that a compressor of numcodecs compressed.

    Raises
    ------
    Exception
        When the data are damaged, or contain fewer or more bytes. No more than `size` bytes are
        allocated for the result.

    Examples
    --------
    >>> codec = numcodecs.Zstd()
    >>> decode_exactly(codec, codec.encode(b"abc"), 3).tobytes()
    b'abc'
    """
    content = np.ascontiguousarray(data).reshape(-1).view(np.uint8).data
    name = codec.codec_id
    if name in _STREAMS:
        stream = _STREAMS[name]()
        # One byte more than expected is enough to notice that there are more.
        decoded = stream.decompress(content, max_length=size + 1)
        if len(decoded) != size or not stream.eof or stream.unused_data:
            raise ValueError(f"{name}: does not hold exactly the {size} bytes that were expected")
        return np.frombuffer(decoded, np.uint8)
    stated = _stated_size(name, content)
    if stated not in (None, size):
        raise ValueError(f"{name}: expected {size} bytes, but it states {stated}")
    # If zstd states no size, it refuses an output that is too short or too long.
    result = np.empty(size, np.uint8)
    codec.decode(content, out=result)
    return result


def _stated_size(name: str, content: memoryview) -> int | None:
    """Return the number of bytes that compressed data state, or None if they state none."""
    if name == "lz4":
        return int.from_bytes(content[:4], "little")
    if name == "blosc":
        # The library trusts this number, and would read beyond the end of the data.
        if int.from_bytes(content[12:16], "little") != len(content):
            raise ValueError("blosc: truncated")
        return int.from_bytes(content[4:8], "little")
    # RFC 8878, section 3.1.1.1: magic number, descriptor, window, dictionary, and size.
    if len(content) < 6:
        raise ValueError("zstd: truncated")
    descriptor = content[4]
    has_window, dictionary = not descriptor & 32, (0, 1, 2, 4)[descriptor & 3]
    length = _ZSTD_SIZE_BYTES[descriptor >> 6] or (0 if has_window else 1)
    start = 5 + has_window + dictionary
    stated = int.from_bytes(content[start : start + length], "little")
    return None if length == 0 else stated + 256 * (length == 2)


class _ExactCodec(Codec):  # type: ignore[misc]
    """A compressor of version 2, which decodes exactly `size` bytes."""

    codec_id = "exact"

    def __init__(self, codec: Codec, size: int) -> None:
        self._codec, self._size = codec, size

    def encode(self, buf: Any) -> Any:
        return self._codec.encode(buf)

    def decode(self, buf: Any, out: Any = None) -> npt.NDArray[np.uint8]:
        return decode_exactly(self._codec, buf, self._size)


@dataclasses.dataclass(frozen=True)
class _ExactBytesCodec(BytesBytesCodec):
    """A compressor of version 3, which decodes exactly `size` bytes."""

    codec: Any
    size: int
    is_fixed_size = False

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        data = chunk_bytes.as_numpy_array()
        decoded = await asyncio.to_thread(decode_exactly, self.codec, data, self.size)
        return chunk_spec.prototype.buffer.from_array_like(decoded)

    def compute_encoded_size(self, input_byte_length: int, chunk_spec: Any) -> int:
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class ChunkSizes:
    """Sizes in bytes that follow from the metadata of an array."""

    chunk: int
    """Size of a decoded chunk; inside shards, of an inner chunk."""
    file: int
    """Maximum size of the file of a chunk or shard."""
    part: int
    """Maximum size of a part of a shard that is read at once."""
    chunks_per_file: int
    """Number of chunks in a file: 1, or the number of those in a shard."""


def bound_codecs(metadata: Any, itemsize: int) -> tuple[Any, ChunkSizes]:
    """Return the metadata of an array with compressors that decode exactly the bytes of a chunk.

    Raises
    ------
    ValueError
        When a chunk is too large, or its size after each codec does not follow from the metadata.
    """
    if metadata.zarr_format == 2:
        filters = tuple(metadata.filters or ())
        chain = [*filters, *filter(None, [metadata.compressor])]
        size = math.prod(metadata.chunks) * itemsize
        exact, limit = _bound_chain([(codec.codec_id, codec) for codec in chain], size, _ExactCodec)
        changes = {
            "filters": tuple(exact[: len(filters)]) or None,
            "compressor": next(iter(exact[len(filters) :]), None),
        }
        return dataclasses.replace(metadata, **changes), ChunkSizes(size, limit, limit, 1)
    shape, codecs = metadata.chunk_grid.chunk_shape, tuple(metadata.codecs)
    if [_name(codec) for codec in codecs] == ["sharding_indexed"]:
        shard, sizes = _bound_shard(codecs[0], shape, itemsize)
        return dataclasses.replace(metadata, codecs=(shard,)), sizes
    size = math.prod(shape) * itemsize
    exact, limit = _bound_version_3(codecs, size)
    return dataclasses.replace(metadata, codecs=tuple(exact)), ChunkSizes(size, limit, limit, 1)


def _bound_shard(codec: Any, shape: tuple[int, ...], itemsize: int) -> tuple[Any, ChunkSizes]:
    """Return the codec of a shard with exact compressors."""
    chunks = math.prod(shape) // max(1, math.prod(codec.chunk_shape))
    if chunks > _MAX_SHARD_CHUNKS:
        raise ValueError(f"expected at most {_MAX_SHARD_CHUNKS} chunks in a shard, got {chunks}")
    if not {_name(each) for each in codec.index_codecs} <= {"bytes", "crc32c"}:
        raise ValueError("index_codecs: expected only bytes and crc32c")
    size = math.prod(codec.chunk_shape) * itemsize
    exact, limit = _bound_version_3(codec.codecs, size)
    index_bytes = 16 * chunks + 4 * len(codec.index_codecs)
    shard = dataclasses.replace(codec, codecs=tuple(exact))
    return shard, ChunkSizes(size, chunks * limit + index_bytes, max(limit, index_bytes), chunks)


def _bound_version_3(codecs: Sequence[Any], size: int) -> tuple[list[Any], int]:
    def make_exact(codec: Any, size: int) -> _ExactBytesCodec:
        # Only the name matters for decoding.
        return _ExactBytesCodec(numcodecs.get_codec({"id": _name(codec)}), size)

    return _bound_chain([(_name(codec), codec) for codec in codecs], size, make_exact)


def _name(codec: Any) -> str:
    return str(codec.to_dict()["name"])


def _bound_chain(
    codecs: list[tuple[str, Any]], size: int, make_exact: Callable[[Any, int], Any]
) -> tuple[list[Any], int]:
    """Return codecs in the order of encoding, with each compressor replaced by an exact one.

    Parameters
    ----------
    codecs : list of (str, codec)
        The codecs with their names.
    size : int
        Size of a decoded chunk in bytes.
    make_exact : callable
        ``make_exact(codec, size)`` returns the compressor that decodes exactly `size` bytes.

    Returns
    -------
    list
        The codecs.
    int
        Maximum size of an encoded chunk.
    """
    bounded, is_compressed = [], False
    _check_chunk_bytes(size)
    for name, codec in codecs:
        if name in _CHECKSUMS:
            size += 4
        elif is_compressed:
            raise ValueError(f"codecs: expected only checksums after a compressor, got {name}")
        elif name in _COMPRESSORS:
            # Compression makes random data a little longer.
            bounded.append(make_exact(codec, size))
            size, is_compressed = 2 * size + 1024, True
            continue
        elif name == "delta" and codec.dtype.kind in "biuf" and codec.astype.kind in "biuf":
            size = size // codec.dtype.itemsize * codec.astype.itemsize
            _check_chunk_bytes(size)
        elif name == "packbits":
            has_padding = getattr(codec, "padding_encoding", "first_byte") != "none"
            size = (size + 7) // 8 + has_padding
        elif name not in _SAME_SIZE:
            raise ValueError(f"codecs: the size of a chunk after {name} is unknown")
        bounded.append(codec)
    return bounded, size


def _check_chunk_bytes(size: int) -> None:
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"expected chunks of at most {MAX_CHUNK_BYTES} bytes, got {size}")
