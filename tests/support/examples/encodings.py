"""Bytes of files: arrays, archives, and images with valid checksums."""

import functools
import gzip
import io
import json
import tempfile
import zipfile
import zlib
from pathlib import Path

import numpy as np

from jotlight.formats.files.checksums import is_sealed, seal


def npy_bytes(array, **options):
    """Return the bytes of a `.npy` file."""
    file = io.BytesIO()
    np.save(file, array, **options)
    return file.getvalue()


def gzip_bytes(content):
    """Return compressed bytes, always the same: by default gzip stores the time."""
    return gzip.compress(content, mtime=0)


def npz_bytes(content):
    """Return the bytes of a `.npz` archive whose only member has these bytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", content)
    return file.getvalue()


def npz_member(content):
    """Return the bytes of the first member of an archive: the inverse of :func:`npz_bytes`."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return archive.read(archive.namelist()[0])


def with_png_checksums(content):
    """Return the bytes of a PNG with the checksum of every complete chunk corrected."""
    png, position = bytearray(content), 8
    while position + 12 <= len(png):
        end = position + 8 + int.from_bytes(png[position : position + 4], "big")
        if end + 4 > len(png):
            break
        png[end : end + 4] = zlib.crc32(png[position + 4 : end]).to_bytes(4, "big")
        position = end + 4
    return bytes(png)


def with_seal(content):
    """Return sealed JSON with its checksum corrected. Other bytes stay as they are."""
    try:
        if is_sealed(content.decode()):
            object_ = json.loads(content)
            del object_["checksum"]
            return seal(object_).encode()
    except (ValueError, TypeError, KeyError, RecursionError):
        pass  # They are no JSON, which the reader finds out.
    return content


def safetensors_header(content):
    """Return the JSON header of a `.safetensors` file."""
    return content[8 : 8 + int.from_bytes(content[:8], "little")]


def around_header(maker):
    """Return options of a Reader whose JSON header is damaged, while its tensors stay intact."""

    def wrap(header):
        return len(header).to_bytes(8, "little") + header + tensors()

    @functools.cache
    def tensors():
        with tempfile.TemporaryDirectory() as folder:
            maker(Path(folder) / "a.safetensors")
            content = (Path(folder) / "a.safetensors").read_bytes()
        return content[8 + len(safetensors_header(content)) :]

    return {"wrap": wrap, "unwrap": safetensors_header, "json": True}


def save_array(path, array):
    """Write a `.npy` file."""
    path.write_bytes(npy_bytes(array))


def array_makers(*arrays):
    """Return a maker of a `.npy` file for each array."""
    return tuple(functools.partial(save_array, array=array) for array in arrays)


INSIDE_GZIP = {"wrap": functools.partial(gzip.compress, compresslevel=1), "unwrap": gzip.decompress}
"""Options of a Reader whose decompressed bytes are damaged."""

SEALED = {"wrap": with_seal, "json": True}
"""Options of a Reader of sealed JSON, which would refuse damage with a wrong checksum at once."""

INSIDE_NPZ = {"wrap": npz_bytes, "unwrap": npz_member}

PNG_CHECKSUMS = {"wrap": with_png_checksums}
"""Options of a Reader of a PNG, which would refuse damage with wrong checksums at once."""
