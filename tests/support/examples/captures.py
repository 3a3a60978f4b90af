"""Examples of every format that `jotlight.open` reads, and of masks."""

import functools
import json

import numpy as np
import tifffile
from PIL import Image

import jotlight as jl
from examples.encodings import (
    INSIDE_GZIP,
    INSIDE_NPZ,
    PNG_CHECKSUMS,
    SEALED,
    array_makers,
    gzip_bytes,
)
from examples.reader import Reader
from jotlight.formats.images.maps import read_mask
from jotlight.formats.npy.description import description_path
from jotlight.formats.writing import write_capture
from jotlight.formats.zarr.manifest import BITS_ARRAY, MANIFEST

RNG = np.random.default_rng(0)
BITS = jl.Bits.from_array(RNG.random((3, 6, 13)) < 0.4)
COLOR = jl.Bits.from_array(RNG.random((2, 5, 9, 3)) < 0.4)
FULL_FRAMES = jl.Bits.from_array(RNG.random((2, 512, 512)) < 0.1)
HALF_FRAMES = jl.Bits.from_array(RNG.random((2, 256, 512)) < 0.1)
DARK_FRAMES = jl.Bits.from_array(RNG.random((2, 512, 512)) < 1e-4)
COUNTS = RNG.integers(0, 300, (6, 9), np.int32)
SENSOR_WITH_MAPS = jl.Sensor(
    frames=3, dark_counts=RNG.random((6, 13)) / 9, mask=RNG.random((6, 13)) < 0.1, gain=2.0
)
BITS_WITH_MAPS = jl.Bits(BITS.packed, BITS.width, SENSOR_WITH_MAPS)
RAW = {
    "swissspad2": HALF_FRAMES,
    "swissspad2-full": FULL_FRAMES,
    "spad512s": FULL_FRAMES,
    "spad512s-sparse": DARK_FRAMES,
}


def open_counts(path, **options):
    """Return the counts of a capture, after checking that its frames can have them."""
    data = jl.open(path, **options)
    counts = data.counts(1) if isinstance(data, jl.Bits) else data
    assert counts.dtype == np.int32
    assert counts.min() >= 0
    assert not isinstance(data, jl.Bits) or counts.max() <= len(data)
    return counts


def written(name, *captures):
    """Return a maker that writes a capture with jotlight, for each capture."""
    return tuple(functools.partial(write_capture, data, name=name) for data in captures)


def without_checksums(name, *captures):
    """Return makers as :func:`written`, of files without checksums that refuse all damage."""

    def make(path, data):
        write_capture(data, path, name)
        description = description_path(path)
        content = json.loads(description.read_text())
        for entry in (content, *content.get("maps", {}).values()):
            entry.pop("checksum", None)
            entry.pop("sha256")
        description.write_text(json.dumps(content))

    return tuple(functools.partial(make, data=data) for data in captures)


def _npz(path):
    np.savez_compressed(path, a=COUNTS)


def _mat(data, **options):
    def make(path):
        from scipy.io import savemat

        savemat(path, data, **options)

    return make


def _mat_7_3(path):
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        file["OUTPUT"] = np.eye(9).reshape(3, 3, 9)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512))


def _hdf5(path, libver="latest"):
    import h5py

    with h5py.File(path, "w", libver=libver) as file:
        file.create_dataset("b", data=np.eye(5, dtype=bool)[None], chunks=(1, 3, 3), shuffle=True)


def _matlab_folder(path):
    write_capture(BITS, path, "matlab")
    # Without the checksum of the part, which would refuse all damage at once.
    (path / "info.json").unlink()


def _without_extension(name, extension):
    def make(path):
        file = path.with_name(f"made{extension}")
        write_capture(COUNTS, file, name)
        file.rename(path)

    return make


def _zarr(path, **options):
    import zarr

    array = zarr.open_array(str(path), mode="w", shape=COUNTS.shape, dtype="i4", **options)
    array[...] = COUNTS


def _raw_gzip(path):
    write_capture(HALF_FRAMES, path.with_name("made.bin"), "swissspad2")
    path.write_bytes(gzip_bytes(path.with_name("made.bin").read_bytes()))


def _stated_layout(path):
    rows = np.pad(BITS.packed, [(0, 0), (0, 0), (0, 1)])
    path.write_bytes(b"".join(b"HD" + frame.tobytes() for frame in rows))


def tiff(array, **options):
    """Return a maker of a TIFF file."""
    return lambda path: tifffile.imwrite(path, array, **options)


def black_and_white(path):
    """Write a PNG of depth 1."""
    Image.fromarray(SENSOR_WITH_MAPS.mask).save(path)


def palette(path):
    """Write a PNG with a palette of four colors."""
    Image.fromarray(COUNTS.astype(np.uint8) % 4).convert("P").save(path, bits=2)


CAPTURES = {
    "npy": Reader(
        "a.npy",
        open_counts,
        array_makers(
            *(BITS.packed, COLOR.packed, COUNTS, COUNTS.T, COUNTS[:4, None], COUNTS[None] > 99)
        ),
    ),
    "npy-description": Reader(
        "a.npy", open_counts, written("npy", BITS_WITH_MAPS), file="a.json", **SEALED
    ),
    "npy-seal": Reader("a.npy", open_counts, written("npy", BITS_WITH_MAPS), file="a.json"),
    "npy-map": Reader(
        "a.npy",
        open_counts,
        without_checksums("npy", BITS_WITH_MAPS),
        file="a.dark_counts.npy",
    ),
    "npy.gz": Reader("a.npy.gz", open_counts, without_checksums("npy.gz", BITS, COUNTS)),
    "npy.gz-inside": Reader(
        "a.npy.gz", open_counts, without_checksums("npy.gz", COLOR, COUNTS), **INSIDE_GZIP
    ),
    "npz": Reader("a.npz", open_counts, (_npz, *written("npz", COUNTS))),
    "npz-inside": Reader("a.npz", open_counts, written("npz", COUNTS, COUNTS.T), **INSIDE_NPZ),
    "visionsim": Reader(
        "a", open_counts, written("visionsim", BITS, COLOR), file="a/transforms.json", json=True
    ),
    "visionsim-frames": Reader(
        "a", open_counts, written("visionsim", BITS, COLOR), file="a/frames.npy"
    ),
    "any-format": Reader(
        "a",
        open_counts,
        tuple(
            _without_extension(name, extension)
            for name, extension in (("npy", ".npy"), ("npz", ".npz"), ("png", ".png"))
        ),
    ),
    "swissspad2-gzip": Reader(
        "a.bin.gz", functools.partial(open_counts, format="swissspad2"), (_raw_gzip,)
    ),
    **{
        name: Reader("a.bin", functools.partial(open_counts, format=name), written(name, bits))
        for name, bits in RAW.items()
    },
    "raw": Reader(
        "a.raw",
        functools.partial(open_counts, layout="6x13,row_bytes=3,frame_header=2"),
        (_stated_layout,),
    ),
    "matlab": Reader(
        "a.mat",
        open_counts,
        (
            _mat({"OUTPUT": np.eye(4, dtype=np.uint8).reshape(2, 4, 2)}),
            _mat({"a": np.eye(4, dtype=bool)}, do_compression=True),
            _mat({"OUTPUT": np.eye(4), "b": {"c": np.ones(3)}, "d": "e"}),
        ),
    ),
    "matlab-description": Reader(
        "a", open_counts, written("matlab", BITS), file="a/info.json", **SEALED
    ),
    "matlab-part": Reader("a", open_counts, (_matlab_folder,), file="a/part_1.mat"),
    "matlab-7.3": Reader(
        "a.mat",
        open_counts,
        (_mat_7_3,),
        needs="h5py",
        read_isolated=functools.partial(open_counts, isolate=True),
    ),
    "tiff": Reader(
        "a.tif",
        open_counts,
        (
            *written("tiff", COUNTS),
            tiff(np.ones((3, 5, 9), np.uint16), photometric="minisblack", compression="zlib"),
            tiff(
                np.ones((3, 32, 32), np.uint8),
                photometric="minisblack",
                tile=(16, 16),
                bigtiff=True,
                byteorder=">",
            ),
            tiff(np.ones((3, 5, 9), np.uint16), imagej=True, metadata={"axes": "TYX"}),
            tiff(np.ones((3, 5, 9), np.uint8), ome=True, metadata={"axes": "TYX"}),
        ),
    ),
    "png": Reader(
        "a.png",
        open_counts,
        (*written("png", COUNTS, COUNTS % 256), black_and_white, palette),
        **PNG_CHECKSUMS,
    ),
    "hdf5": Reader(
        "a.h5",
        open_counts,
        (
            *written("hdf5", BITS, COUNTS),
            _hdf5,
            # The oldest versions of the structures in the file have no checksums.
            functools.partial(_hdf5, libver="earliest"),
        ),
        needs="h5py",
        read_isolated=functools.partial(open_counts, isolate=True),
    ),
    "zarr": Reader("a", open_counts, (_zarr,), file="a/zarr.json", json=True, needs="zarr"),
    "zarr-manifest": Reader(
        "a",
        open_counts,
        written("zarr", BITS_WITH_MAPS),
        file=f"a/{BITS_ARRAY}/{MANIFEST}",
        needs="zarr",
        **SEALED,
    ),
    "zarr-2": Reader(
        "a",
        open_counts,
        (functools.partial(_zarr, zarr_format=2),),
        file="a/.zarray",
        json=True,
        needs="zarr",
    ),
    "zarr-chunk": Reader("a", open_counts, (_zarr,), file="a/c/0/0", needs="zarr"),
    "mask": Reader("a.npy", read_mask, array_makers(SENSOR_WITH_MAPS.mask)),
    "mask-png": Reader(
        "a.png", read_mask, (black_and_white, *written("png", COUNTS)), **PNG_CHECKSUMS
    ),
}
"""Readers of captures, by the name of the format or what is damaged in it."""
