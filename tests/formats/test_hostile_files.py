"""Damaged and hostile files: they are read or refused by name, in little memory."""

import gzip
import io
import json
import tracemalloc

import numpy as np
import png
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

import jotlight as jl
from examples import READERS, read_or_refused
from examples.captures import COUNTS, open_counts
from reference import formats as twin

pytestmark = pytest.mark.slow

MAX_MEMORY = 150 << 20
"""Maximum memory in bytes for a file of some kilobytes. Any file may claim 16 MiB."""


def read_in_little_memory(path, read=open_counts):
    """Return what a reader returns, or None when it refuses, and check its memory."""
    tracemalloc.start()
    try:
        return read_or_refused(read, path)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < MAX_MEMORY


@st.composite
def damage(draw):
    """Draw a function that cuts bytes, appends some, flips bits, or overwrites some."""
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
            # Headers, which matter most, are near the beginning.
            changed[int(where * near * len(changed))] ^= 1 << bit
        return bytes(changed)

    return change


@pytest.mark.parametrize("name", READERS)
def test_every_example_is_read(name, tmp_path):
    reader = READERS[name]
    pytest.importorskip(reader.needs)
    for number in range(len(reader.makers)):
        folder = tmp_path / str(number)
        folder.mkdir()
        path, file, content = reader.example(folder, number)
        assert reader.unwrap(reader.wrap(content)) == content
        file.write_bytes(reader.wrap(content))
        assert read_in_little_memory(path, reader.read) is not None


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_read_or_refused(name, tmp_path_factory):
    reader = READERS[name]
    pytest.importorskip(reader.needs)
    examples = [
        reader.example(tmp_path_factory.mktemp("damaged"), number)
        for number in range(len(reader.makers))
    ]

    # fuzz/readers.py tries many more.
    @settings(max_examples=15)
    @given(damage(), st.sampled_from(examples))
    def check(change, example):
        path, file, content = example
        file.write_bytes(reader.wrap(change(content)))
        read_in_little_memory(path, reader.read)

    check()


SETTINGS = b',"{""quick"": true, ""BM3D"": ""4.0.3""}"'
"""The last cell of the example of results."""

FOUND = {
    "a type that SciPy crashes on": ("matlab", 0, b"\2\0\0\0\x10\0\0\0", b"\xf9\0\0\0\x10\0\0\0"),
    "a variable has more numbers than bytes": (
        "matlab",
        2,
        b"\4\0\0\0\4\0\0\0\1\0\0\0",
        b"\4\0\4\0\4\0\x60\0\1\0\0\0",
    ),
    "an empty array has a length beyond 64 bits": (
        "zarr",
        0,
        b"6,\n    9\n",
        b"118059162071741130342,\n    0\n",
    ),
    "elements are arrays": ("mask", 0, b"'|b1'", b"'1b1'"),
    "the name of a codec is a list": ("zarr", 0, b'"name": "bytes"', b'"name": []'),
    "the id of a codec is a list": ("zarr-2", 0, b'"id": "zstd"', b'"id": []'),
    "chunks are empty": ("zarr-2", 0, b'"chunks": [\n    6,\n    9\n  ]', b'"chunks": 0'),
    "metadata are null": (
        "network-header",
        0,
        b'"__metadata__": {',
        b'"__metadata__": null, "a": {',
    ),
    "rows are no list": ("results-part", 0, b'[{"cost": 1.5, "step": 2}]', b"1"),
    "an image is larger than its file": (
        "results-image",
        0,
        b"\0\0\5\0\0\0\5\x08",
        b"\0\0\5\2\0\0\5\x08",
    ),
    "one of three numbers is missing": ("calibration-header", 0, b"flat_noise", b"prnu"),
    "the width is no number": ("image", 1, b"9 6", b"9 x"),
    "the size exceeds any file": ("image", 4, b"\x09\0\x06\0", b"\x09\x21\x21\x21"),
    "compressed data are damaged": ("image-tiff", 1, b"x\x9c", b"x\0"),
    "a column is unknown": ("results-facts", 0, b"experiment", b"x"),
    "a cell is missing": ("results-facts", 0, SETTINGS, b""),
}
"""What fuzz/readers.py found: reader, number of its example, old bytes, and new bytes."""


@pytest.mark.parametrize(("name", "number", "old", "new"), FOUND.values(), ids=FOUND)
def test_files_that_fuzzing_found_are_refused(name, number, old, new, tmp_path):
    reader = READERS[name]
    pytest.importorskip(reader.needs)
    path, file, content = reader.example(tmp_path, number)
    assert old in content
    file.write_bytes(reader.wrap(content.replace(old, new, 1)))
    assert read_in_little_memory(path, reader.read) is None


def test_a_result_whose_settings_are_nested_too_deep_is_left_out(tmp_path):
    path, file, content = READERS["results-facts"].example(tmp_path)
    file.write_bytes(content.replace(SETTINGS, b"," + 1500 * b"[" + 1500 * b"]"))
    with pytest.warns(jl.JotlightWarning, match="fig5 is left out"):
        assert READERS["results-facts"].read(path) == {}


@given(st.tuples(*[st.integers(-(2**65), 2**65) | st.integers(0, 9)] * 3), st.booleans())
def test_no_npy_header_takes_much_memory(tmp_path_factory, shape, zipped):
    folder = tmp_path_factory.mktemp("header")
    text = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    content = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(64)
    path = folder / ("a.npy.gz" if zipped else "a.npy")
    path.write_bytes(gzip.compress(content) if zipped else content)
    read_in_little_memory(path)


def test_frames_of_an_empty_array_take_no_memory(tmp_path):
    header = b"{'descr': '|u1', 'fortran_order': False, 'shape': (0, 60000, 60000)}\n"
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(64)
    (tmp_path / "a.npy").write_bytes(content)
    assert read_in_little_memory(tmp_path / "a.npy") is None


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
    | st.sampled_from(["a.npy", "../a.npy", "/dev/zero", "a\0", "."]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=5,
)  # fmt: skip


DATA_SET_KEYS = st.sampled_from(["w", "h", "c", "bitpack", "bitpack_dim", "file_path"])
FRAME_KEYS = st.sampled_from(["file_path", "offset", "bitpack_dim"])


@settings(max_examples=40)
@given(
    st.dictionaries(DATA_SET_KEYS, JSON),
    JSON | st.lists(st.dictionaries(FRAME_KEYS, JSON), max_size=3),
)
def test_any_description_of_visionsim_is_read_or_refused(tmp_path_factory, changes, frames):
    folder = tmp_path_factory.mktemp("set")
    np.save(folder / "a.npy", twin.packed(np.ones((3, 6, 13), bool)))
    good = {"w": 13, "h": 6, "c": 1, "bitpack": True, "bitpack_dim": 2, "file_path": "a.npy"}
    text = json.dumps({**good, **changes, "frames": frames})
    (folder / "transforms.json").write_text(text)
    read_in_little_memory(folder)


@pytest.mark.parametrize(("width", "height"), [(2**31 - 1, 2**31 - 1), (60000, 60000), (0, 5)])
def test_a_png_that_claims_another_size_is_refused(tmp_path, width, height):
    file = io.BytesIO()
    png.Writer(4, 4, greyscale=True).write(file, [[0] * 4] * 4)
    content = bytearray(file.getvalue())
    content[16:24] = width.to_bytes(4, "big") + height.to_bytes(4, "big")
    (tmp_path / "a.png").write_bytes(bytes(content))
    assert read_in_little_memory(tmp_path / "a.png") is None


def test_a_tiff_that_claims_another_size_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((777, 777), np.uint16), compression="zlib")
    content = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(
        content.replace((777).to_bytes(4, "little"), (10**6).to_bytes(4, "little")).replace(
            (777).to_bytes(2, "little") + b"\0\0", (65535).to_bytes(2, "little") + b"\0\0"
        )
    )
    assert read_in_little_memory(tmp_path / "a.tif") is None


def test_a_tiff_whose_pages_form_a_cycle_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", COUNTS, metadata=None)
    content = bytearray((tmp_path / "a.tif").read_bytes())
    # The offset of the next page follows the tags of the first page, 12 bytes each.
    after = 10 + 12 * int.from_bytes(content[8:10], "little")
    place = len(content).to_bytes(4, "little")
    content[after : after + 4] = place
    (tmp_path / "a.tif").write_bytes(bytes(content) + b"\0\0" + place)
    assert read_in_little_memory(tmp_path / "a.tif") is None


def test_files_of_objects_are_refused(tmp_path):
    objects = np.array([[{}]], object)
    np.save(tmp_path / "a.npy", objects)
    np.savez(tmp_path / "a.npz", a=objects)
    (tmp_path / "a.npy.gz").write_bytes(gzip.compress((tmp_path / "a.npy").read_bytes()))
    for name in ("a.npy", "a.npz", "a.npy.gz"):
        with pytest.raises(ValueError, match="Python objects"):
            jl.open(tmp_path / name)
