"""Damaged and hostile files: a clear error or a picture, within little memory, and no crash."""

import gzip
import io
import json
import tracemalloc
import warnings
import zipfile

import numpy as np
import png
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from jotlight.formats.writing import TARGETS, write_capture
from reference import formats as twin

MOST_MEMORY = 150 << 20
"""Bytes, for files of some kilobytes; a claim of 16 MiB in a few bytes is believed."""

BITS = jl.Bits.from_array(np.random.default_rng(0).random((3, 6, 13)) < 0.4)
WIDE = np.random.default_rng(0).random((2, 512, 512)) < 0.1
IMAGE = np.random.default_rng(0).integers(0, 300, (6, 9), np.int32)
NEEDS = {"hdf5": "h5py", "zarr": "zarr"}


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def opened(path, **options):
    """What opening and counting come to: a picture, or an error that says which file."""
    said = None
    tracemalloc.start()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            data = jl.open(path, **options)
            counts = data.counts(1) if isinstance(data, jl.Bits) else data
    except (OSError, ValueError, jl.MissingExtraError) as error:
        said = str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < MOST_MEMORY
    if said is None:
        assert counts.dtype == np.int32
        assert counts.min() >= 0
        return counts
    assert len(said) > 10
    return None


@st.composite
def damage(draw):
    """A function that truncates, extends or flips."""
    kind = draw(st.sampled_from(["cut", "extend", "flip", "fill", "zeros"]))
    place = draw(st.floats(0, 1, exclude_max=True))
    near = draw(st.sampled_from([1.0, 0.1, 0.01]))
    flips = draw(st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)),
                          min_size=1, max_size=6))  # fmt: skip
    more = draw(st.binary(max_size=40))
    fill = draw(st.binary(min_size=1, max_size=8))

    def change(content):
        if kind == "cut":
            return content[: int(place * len(content))]
        if kind == "extend":
            return content + more
        if kind == "zeros":
            return bytes(len(content))
        changed = bytearray(content)
        if kind == "fill":
            at = int(place * near * len(changed))
            changed[at : at + len(fill)] = fill
        for where, bit in flips if kind == "flip" else ():
            # Most of what a reader believes is near the beginning.
            changed[int(where * near * len(changed))] ^= 1 << bit
        return bytes(changed)

    return change


def capture(folder, name, data):
    endings = TARGETS[name].endings
    path = folder / ("a" + (endings[0] if endings else ""))
    write_capture(data, path, name)
    return path


def files_of(path):
    return [file for file in sorted(path.rglob("*")) if file.is_file()] if path.is_dir() else [path]


SEEDS = [
    *((name, BITS) for name in ("npy", "npy.gz", "visionsim", "matlab", "hdf5", "zarr")),
    *((name, IMAGE) for name in ("npy", "npz", "tiff", "png", "hdf5", "zarr")),
    *((name, WIDE) for name in ("swissspad2-full", "spad512s", "spad512s-sparse")),
]


@pytest.mark.parametrize(
    ("name", "data"), SEEDS, ids=[f"{name}-{type(data).__name__}" for name, data in SEEDS]
)
def test_a_damaged_capture_is_an_error_or_a_picture(name, data, tmp_path_factory):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    data = jl.Bits.from_array(data) if data is WIDE else data
    folder = tmp_path_factory.mktemp("damaged")
    path = capture(folder, name, data)
    files = files_of(path)
    whole = [file.read_bytes() for file in files]
    # Nothing tells what raw frames are.
    told = name if name.startswith("s") else None
    expected = data.counts(1) if isinstance(data, jl.Bits) else data

    @given(damage(), st.integers(0, len(files) - 1))
    def check(change, which):
        files[which].write_bytes(change(whole[which]))
        try:
            counts = opened(path, format=told)
            if change(whole[which]) == whole[which]:
                np.testing.assert_array_equal(counts, expected)
        finally:
            files[which].write_bytes(whole[which])

    check()


@given(damage(), st.booleans())
def test_a_damaged_array_in_an_archive_is_an_error_or_a_picture(tmp_path_factory, change, zipped):
    folder = tmp_path_factory.mktemp("inner")
    content = change(npy(IMAGE))
    if zipped:
        path = folder / "a.npz"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("a.npy", content)
    else:
        path = folder / "a.npy.gz"
        path.write_bytes(gzip.compress(content))
    opened(path)


@given(st.tuples(*[st.integers(-(2**65), 2**65) | st.integers(0, 9)] * 3), st.booleans())
def test_no_header_is_believed(tmp_path_factory, shape, zipped):
    folder = tmp_path_factory.mktemp("header")
    text = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    content = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(64)
    path = folder / ("a.npy.gz" if zipped else "a.npy")
    path.write_bytes(gzip.compress(content) if zipped else content)
    opened(path)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
    | st.sampled_from(["a.npy", "../a.npy", "/dev/zero", "a\0", "."]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=5,
)  # fmt: skip


SET = st.sampled_from(["w", "h", "c", "bitpack", "bitpack_dim", "file_path"])
FRAME = st.sampled_from(["file_path", "offset", "bitpack_dim"])


@given(st.dictionaries(SET, JSON), JSON | st.lists(st.dictionaries(FRAME, JSON), max_size=3))
def test_no_description_of_visionsim_is_believed(tmp_path_factory, told, frames):
    folder = tmp_path_factory.mktemp("set")
    np.save(folder / "a.npy", twin.packed(np.ones((3, 6, 13), bool)))
    good = {"w": 13, "h": 6, "c": 1, "bitpack": True, "bitpack_dim": 2, "file_path": "a.npy"}
    text = json.dumps({**good, **told, "frames": frames})
    (folder / "transforms.json").write_text(text)
    opened(folder)


@pytest.mark.parametrize(("width", "height"), [(2**31 - 1, 2**31 - 1), (60000, 60000), (0, 5)])
def test_a_png_is_not_unpacked_for_what_it_claims(tmp_path, width, height):
    file = io.BytesIO()
    png.Writer(4, 4, greyscale=True).write(file, [[0] * 4] * 4)
    content = bytearray(file.getvalue())
    content[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
    (tmp_path / "a.png").write_bytes(bytes(content))
    assert opened(tmp_path / "a.png") is None


def test_a_tiff_is_not_unpacked_for_what_it_claims(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((777, 777), np.uint16), compression="zlib")
    content = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(
        content.replace((777).to_bytes(4, "little"), (10**6).to_bytes(4, "little")).replace(
            (777).to_bytes(2, "little") + b"\0\0", (65535).to_bytes(2, "little") + b"\0\0"
        )
    )
    assert opened(tmp_path / "a.tif") is None


def test_pickles_are_never_read(tmp_path):
    objects = np.array([[{}]], object)
    np.save(tmp_path / "a.npy", objects)
    np.savez(tmp_path / "a.npz", a=objects)
    (tmp_path / "a.npy.gz").write_bytes(gzip.compress((tmp_path / "a.npy").read_bytes()))
    for name in ("a.npy", "a.npz", "a.npy.gz"):
        with pytest.raises(ValueError, match="Python objects"):
            jl.open(tmp_path / name)
