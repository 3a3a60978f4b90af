"""Reading arrays from `.npy` and `.npz` files: damaged files, and files that hold objects."""

import pickle
import zipfile

import numpy as np
import pytest

import jotlight as jl
from examples.encodings import npy_bytes
from folders import file_names
from jotlight.errors import JotlightWarning
from jotlight.formats.npy.archives import read_npz
from jotlight.formats.npy.arrays import read_npy

CUBE = npy_bytes(np.zeros((4, 8, 2), np.uint8))
OBJECTS = npy_bytes(np.array([[[{}]]], object), allow_pickle=True)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (CUBE[:-1], "size does not fit its header"),
        (CUBE[:100], "damaged"),
        (CUBE.replace(b"'|u1'", b"int()"), r"damaged \(it is no dictionary of constants\)$"),
        (CUBE[:8], "damaged"),
        (CUBE[:6], "damaged"),
        (b"", "got an empty file"),
        (b"PK" + CUBE, "does not begin like one"),
        (pickle.dumps(np.zeros(3)), "does not begin like one"),
        (OBJECTS, "Python objects, which can run code and are never read"),
        (b"\x93NUMPY\x09\x00" + CUBE[8:], "damaged"),
        (CUBE.replace(b"'|u1'", b"'|zz'"), "damaged"),
        (CUBE.replace(b"(4, 8, 2)", b"(4, 8,-2)"), "damaged"),
        (CUBE.replace(b"(4, 8, 2), ", b"(9**9**9), "), "damaged"),
        (CUBE.replace(b"(4, 8, 2), }", b"(1" + b"0" * 20 + b",),}")[:128], "damaged"),
        (npy_bytes(np.zeros((4, 8, 2))), "got float64"),
        (npy_bytes(np.zeros((8, 0), np.uint8)), r"shape \(8, 0\)"),
        (npy_bytes(np.zeros((4, 0, 2), np.uint8)), r"cube\.npy: "),
    ],
)
def test_damaged_and_foreign_files_are_refused_by_name(tmp_path, content, message):
    path = tmp_path / "cube.npy"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        jl.open(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("more", [b"1", CUBE])
def test_bytes_after_an_array_are_stated(tmp_path, more):
    path = tmp_path / "cube.npy"
    path.write_bytes(CUBE + more)
    message = rf"cube\.npy: has {len(more)} bytes? beyond the array of shape \(4, 8, 2\)"
    with pytest.warns(JotlightWarning, match=message):
        assert len(jl.open(path)) == 4


def test_no_code_in_a_pickle_runs(tmp_path):
    class Mine:
        def __reduce__(self):
            return (tmp_path.joinpath("ran").write_text, ("x",))

    objects = np.empty((1, 1, 1), object)
    objects[0, 0, 0] = Mine()
    (tmp_path / "cube.npy").write_bytes(npy_bytes(objects, allow_pickle=True))
    with pytest.raises(ValueError, match="Python objects"):
        jl.open(tmp_path / "cube.npy")
    assert file_names(tmp_path) == ["cube.npy"]


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("missing.npy", FileNotFoundError, "there is no file"),
        ("folder.npy", IsADirectoryError, "got a folder"),
        ("cube.bin", FileNotFoundError, "there is no file"),
    ],
)
def test_missing_files_and_folders_are_refused(tmp_path, name, error, message):
    (tmp_path / "folder.npy").mkdir()
    with pytest.raises(error, match=message):
        jl.open(tmp_path / name)


def test_read_npy_reads_floats(tmp_path):
    values = np.linspace(0, 1, 5)
    np.save(tmp_path / "map.npy", values)
    np.testing.assert_array_equal(read_npy(tmp_path / "map.npy"), values)


def test_a_deeply_nested_header_is_refused(tmp_path):
    path = tmp_path / "deep.npy"
    header = b"(" * 5000 + b"\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(ValueError, match=r"deep\.npy"):
        jl.open(path)


def test_a_member_that_claims_more_than_it_holds_is_refused(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 100000)}\n"
    member = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(80)
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as archive:
        archive.writestr("a.npy", member)
    with pytest.raises(ValueError, match="its header claims 800000000000 bytes, but there are"):
        read_npz(tmp_path / "lie.npz")
    np.savez(tmp_path / "good.npz", a=np.arange(6).reshape(2, 3))
    assert read_npz(tmp_path / "good.npz").tolist() == [[0, 1, 2], [3, 4, 5]]
