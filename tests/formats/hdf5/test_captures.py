"""HDF5 files: data sets, labels, and hostile files."""

import hashlib
import os
import shutil
import signal
import sys

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_bits, random_frames
from examples.captures import BITS_WITH_MAPS
from jotlight.errors import ChangedFileError
from jotlight.formats.hdf5.captures import list_data_sets
from jotlight.formats.hdf5.isolated import IsolatedLibrary
from jotlight.formats.hdf5.library import Hdf5Library
from jotlight.formats.verification import verify_capture
from jotlight.output_files import OutputFile
from reference import formats as twin

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


def test_data_sets_are_chosen_by_name(tmp_path):
    h5py = pytest.importorskip("h5py")
    array = random_frames((4, 5, 16))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a/counts"] = COUNTS
        file["bool"] = array
        file["cube"] = twin.packed(array)
        file["out"] = h5py.ExternalLink("other.h5", "x")
    counts = jl.open(tmp_path / "a.h5", key="/a/counts", frames=slice(0, 3))
    np.testing.assert_array_equal(counts, COUNTS[:3].sum(0))
    np.testing.assert_array_equal(jl.open(tmp_path / "a.h5", key="bool").to_array(), array)
    bits = jl.open(tmp_path / "a.h5", key="cube", counts=False, width=15)
    np.testing.assert_array_equal(bits.to_array(), array[..., :15])
    for key in (None, "out", "none"):
        with pytest.raises(ValueError, match=r"--key.*a/counts, bool, cube"):
            jl.open(tmp_path / "a.h5", key=key)


@pytest.mark.parametrize("label", ["{}", 3])
def test_a_label_of_another_type_is_ignored_with_a_warning(tmp_path, label):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = COUNTS[0]
        file["a"].attrs["jotlight"] = label  # h5py stores a str with variable length
    with pytest.warns(jl.JotlightWarning, match="jotlight of a is not a string of fixed length"):
        counts = jl.open(tmp_path / "a.h5")
    np.testing.assert_array_equal(counts, COUNTS[0])


def test_a_file_cannot_refer_to_other_files_or_claim_more_than_it_holds(tmp_path):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(bytes(64))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (2, 4, 8), "u1", external=[(str(tmp_path / "secret"), 0, 64)])
    with pytest.raises(ValueError, match="in other files"):
        jl.open(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (10**9, 512, 64), "u1", chunks=(1, 512, 64))
    with pytest.raises(ValueError, match=r"only 0 of its 1000000000 (chunks|frames) exist"):
        jl.open(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (10**9, 512, 64), "u1")
    with pytest.raises(ValueError, match="only 0 of its 1000000000 frames exist"):
        jl.open(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (9, 9000, 9000), "u1", chunks=(1, 900, 900))
    with pytest.raises(ValueError, match=r"expected frames of at most .*, got 81000000;"):
        jl.open(tmp_path / "a.h5")


def test_the_files_of_a_virtual_data_set_are_not_opened(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file.create_dataset("x", (7, 8, 8), "u1", maxshape=(None, 8, 8))
    layout = h5py.VirtualLayout((1, 8, 8), "u1", maxshape=(None, 8, 8))
    source = h5py.VirtualSource(
        str(tmp_path / "secret.h5"), "x", shape=(1, 8, 8), maxshape=(None, 8, 8)
    )
    unlimited = slice(0, h5py.h5s.UNLIMITED)
    layout[unlimited] = source[unlimited]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_virtual_dataset("x", layout)
    # The library would have to open the source to know the shape, which is (7, 8, 8).
    (found,) = Hdf5Library().list_data_sets(str(tmp_path / "a.h5"), "jotlight")
    assert (found.layout, found.shape) == ("virtual", ())
    with pytest.raises(ValueError, match="x is a virtual data set, whose parts may be in other"):
        jl.open(tmp_path / "a.h5")


@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_data_set_that_is_not_read_may_be_anything(tmp_path, isolate):
    h5py = pytest.importorskip("h5py")
    image = COUNTS[0]
    layout = h5py.VirtualLayout(image.shape, image.dtype)
    layout[:] = h5py.VirtualSource(".", "counts", image.shape)  # this file
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["counts"] = image
        file.create_virtual_dataset("same", layout)
        file.create_dataset("out", (2, 4, 8), "u1", external=[(str(tmp_path / "secret"), 0, 64)])
        file.create_dataset("empty", (10**9, 512, 64), "u1", chunks=(1, 512, 64))
    counts = jl.open(tmp_path / "a.h5", key="counts", isolate=isolate)
    np.testing.assert_array_equal(counts, image)
    for key, message in (
        ("same", "same is a virtual data set, whose parts may be in other files, and jotlight"),
        ("out", "out is an external data set, whose values are in other files, and jotlight"),
        ("empty", "only 0 of its 1000000000 chunks exist"),
        (None, r"one of its arrays: counts, empty, out \(external\), same \(virtual\)$"),
    ):
        with pytest.raises(ValueError, match=message):
            jl.open(tmp_path / "a.h5", key=key, isolate=isolate)


@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_table_is_refused_unless_there_are_arrays(tmp_path, isolate):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["events"] = np.zeros(9, [("time", "u8"), ("x", "u2")])
    for key in (None, "events", "/events"):
        with pytest.raises(ValueError, match=r"a\.h5: events is a table, such as a list of events"):
            jl.open(tmp_path / "a.h5", key=key, isolate=isolate)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["counts"] = COUNTS[0]
    np.testing.assert_array_equal(jl.open(tmp_path / "a.h5", isolate=isolate), COUNTS[0])


@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_an_array_that_was_allocated_before_the_capture_is_read(tmp_path, isolate):
    h5py = pytest.importorskip("h5py")
    frames = random_frames((20, 256, 256))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        shape, chunks = (100_000, 256, 256), (10, 256, 256)
        file.create_dataset("x", shape, bool, chunks=chunks, compression="gzip")[:20] = frames
    message = r"a\.h5: x: 9998 of its 10000 chunks are missing and are read as the fill value"
    with pytest.warns(jl.JotlightWarning, match=message):
        bits = jl.open(tmp_path / "a.h5", isolate=isolate)
    np.testing.assert_array_equal(bits[:30].counts(), frames.sum(0))


@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_file_that_another_program_is_writing_is_not_called_damaged(tmp_path, isolate):
    h5py = pytest.importorskip("h5py")
    fcntl = pytest.importorskip("fcntl", reason="needs locks of files")
    with h5py.File(tmp_path / "a.h5", "w", libver="latest") as file:
        file["a"] = COUNTS
        file.swmr_mode = True
        shutil.copy(tmp_path / "a.h5", tmp_path / "marked.h5")
    with pytest.raises(OSError, match=r"marked\.h5: another program is writing it.*h5clear"):
        jl.open(tmp_path / "marked.h5", isolate=isolate)
    with (tmp_path / "a.h5").open("rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(OSError, match=r"a\.h5: another program is writing it; open it again"):
            jl.open(tmp_path / "a.h5", isolate=isolate)


@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_another_program_can_write_an_open_file(tmp_path, isolate):
    pytest.importorskip("h5py")
    fcntl = pytest.importorskip("fcntl", reason="needs locks of files")
    jl.save(random_bits((20, 8, 8)), tmp_path / "a.h5")
    bits = jl.open(tmp_path / "a.h5", isolate=isolate)
    with (tmp_path / "a.h5").open("rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.utime(tmp_path / "a.h5", (1, 1))
    with pytest.raises(ChangedFileError, match=r"a\.h5: the file has changed"):
        bits.counts()


def test_the_lock_of_a_file_that_the_caller_has_open_is_kept(tmp_path):
    h5py = pytest.importorskip("h5py")
    fcntl = pytest.importorskip("fcntl", reason="needs locks of files")
    jl.save(random_bits((20, 8, 8)), tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file, (tmp_path / "a.h5").open("rb") as other:
        assert len(jl.open(tmp_path / "a.h5")) == len(file["bits"])
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)


@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("content", "error", "message"),
    [
        (
            "raise ModuleNotFoundError(\"No module named 'h5py'\", name='h5py')",
            jl.MissingExtraError,
            r"^HDF5 and MATLAB 7.3 files need h5py: pip install 'jotlight\[hdf5\]'$",
        ),
        (
            "raise ImportError('libhdf5.so.200: not found')",
            ImportError,
            r"^h5py is installed, but its import failed \(libhdf5\.so\.200: not found\)",
        ),
    ],
)
def test_a_library_that_cannot_be_imported_does_not_blame_the_file(
    tmp_path, monkeypatch, isolate, content, error, message
):
    jl.save(random_bits((20, 8, 8)), tmp_path / "a.h5")
    (tmp_path / "h5py.py").write_text(content)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "h5py")
    with pytest.raises(ImportError, match=message) as info:
        jl.open(tmp_path / "a.h5", isolate=isolate)
    assert type(info.value) is error


def test_a_missing_package_is_named_with_the_command_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.setitem(sys.modules, "zarr", None)
    (tmp_path / "a.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / ".zarray").write_text("{}")
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[hdf5\]'"):
        jl.open(tmp_path / "a.h5")
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[zarr\]'"):
        jl.open(tmp_path / "a")


@pytest.mark.parametrize("size", [512, 1024, 65536])
def test_a_block_before_the_data_is_skipped(tmp_path, size):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.dat", "w", userblock_size=size) as file:
        file["a"] = COUNTS[0]
    np.testing.assert_array_equal(jl.open(tmp_path / "a.dat"), COUNTS[0])
    content = (tmp_path / "a.dat").read_bytes()
    for moved in (bytes(1) + content, content[:-1], content[1:]):
        (tmp_path / "a.dat").write_bytes(moved)
        with pytest.raises(ValueError, match=r"a\.dat"):
            jl.open(tmp_path / "a.dat")


def test_the_text_before_the_data_holds_their_sha256(tmp_path):
    pytest.importorskip("h5py")
    jl.save(COUNTS[0].astype(np.int32), tmp_path / "a.h5")
    content = (tmp_path / "a.h5").read_bytes()
    assert hashlib.sha256(content[512:]).hexdigest().encode() in content[:512]
    assert verify_capture(tmp_path / "a.h5").startswith("1 file matches its checksum")


def test_a_file_changed_by_its_user_is_accepted_without_this_text(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    jl.save(COUNTS[0].astype(np.int32), path)
    with h5py.File(path, "r+") as file:
        file["counts"][0, 0] = 7
    assert jl.open(path)[0, 0] == 7
    with pytest.raises(ValueError, match=r"a\.h5: is damaged or was changed.*512 bytes with zeros"):
        verify_capture(path)
    path.write_bytes(bytes(512) + path.read_bytes()[512:])
    assert verify_capture(path).startswith("there is no checksum")


def test_every_array_has_checksums_that_reading_compares(tmp_path):
    h5py = pytest.importorskip("h5py")
    jl.save(BITS_WITH_MAPS, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        assert sorted(file) == ["bits", "dark_counts", "mask"]
        for name, data_set in file.items():
            assert data_set.fletcher32, name
    content = (tmp_path / "a.h5").read_bytes()
    dark_counts = BITS_WITH_MAPS.sensor.dark_counts.tobytes()
    (tmp_path / "a.h5").write_bytes(content.replace(dark_counts, bytes(len(dark_counts))))
    with pytest.raises(ValueError, match=r"a\.h5: the HDF5 file is damaged"):
        jl.open(tmp_path / "a.h5")


@pytest.mark.slow
@pytest.mark.parametrize("library", [Hdf5Library(), IsolatedLibrary()], ids=["here", "isolated"])
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"chunks": (5, 1024, 2048), "compression": "gzip"}, [(0, 5), (5, 6)]),
        ({"chunks": (5, 256, 512), "fletcher32": True}, [(0, 5), (5, 6)]),
        # Of these, the library reads a part without the rest, or caches the rest.
        ({"chunks": (5, 1024, 2048)}, [(frame, frame + 1) for frame in range(6)]),
        ({"chunks": (2, 8, 2048), "fletcher32": True}, [(frame, frame + 1) for frame in range(6)]),
        ({}, [(frame, frame + 1) for frame in range(6)]),
    ],
)
def test_chunks_that_exceed_the_cache_of_the_library_are_read_once(
    tmp_path, monkeypatch, library, options, expected
):
    h5py = pytest.importorskip("h5py")
    array = np.zeros((6, 1024, 2048), np.uint8)
    array[:, :6, :7] = np.arange(6 * 6 * 7).reshape(6, 6, 7)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a", data=array, **options)
    parts, read = [], library.read

    def count(data_set, start, stop):
        parts.append((start, stop))
        return read(data_set, start, stop)

    monkeypatch.setattr(library, "read", count)
    frames = list_data_sets(tmp_path / "a.h5", library)["a"].open().frames
    for frame in range(6):
        np.testing.assert_array_equal(frames.read(frame, frame + 1), array[frame : frame + 1])
    assert parts == expected


@pytest.mark.parametrize("library", [Hdf5Library, IsolatedLibrary])
def test_positions_of_frames_may_be_numbers_of_numpy(tmp_path, library):
    pytest.importorskip("h5py")
    jl.save(COUNTS[0], tmp_path / "a.h5")
    frames = next(iter(list_data_sets(tmp_path / "a.h5", library()).values())).open().frames
    np.testing.assert_array_equal(frames.read(np.int64(1), np.int64(3)), COUNTS[0, 1:3])


@pytest.mark.parametrize("number", [1, 3])
def test_ctrl_c_while_the_library_writes_ends_the_command_without_a_crash(
    tmp_path, monkeypatch, number
):
    pytest.importorskip("h5py")
    writes = []

    def write(self, data):
        writes.append(len(data))
        if len(writes) == number:
            signal.raise_signal(signal.SIGINT)
        return super(OutputFile, self).write(data)

    monkeypatch.setattr(OutputFile, "write", write, raising=False)
    bits = random_bits((4, 5, 16))
    with pytest.raises(KeyboardInterrupt):
        jl.save(bits, tmp_path / "a.h5")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    jl.save(bits, tmp_path / "a.h5")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.h5"), bits)
