import pickle
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.bits import lazy
from jotlight.sensing.bits.frames import Frames

pytest.importorskip("dask")


@pytest.fixture
def capture(tmp_path):
    path = tmp_path / "capture.npy"
    bits = jl.Bits.from_array(np.random.default_rng(0).random((50, 6, 13)) < 0.4)
    jl.save(bits, path)
    return path


@pytest.mark.parametrize("chunks", [7, 50, 1000, "24B", "1MiB", (7, -1, -1), (-1, 6, 2)])
def test_lazy_bits_equal_the_packed_bits(capture, chunks):
    bits = jl.open(capture)
    lazy_bits = bits.to_dask(chunks)
    assert lazy_bits.dtype == np.uint8
    assert lazy_bits.shape == bits.packed.shape
    np.testing.assert_array_equal(lazy_bits.compute(), np.asarray(bits.packed))


def test_slices_of_lazy_bits_are_those_of_the_array(capture):
    bits = jl.open(capture)
    packed, x = np.asarray(bits.packed), bits.to_dask(8)
    for key in (3, slice(3, 40, 5), slice(40, 3, -4), (slice(2, 9), 1, slice(0, 1)), slice(5, 5)):
        np.testing.assert_array_equal(x[key].compute(), packed[key])


def test_lazy_bits_do_not_hold_the_frames(capture):
    bits = jl.open(capture)
    big = jl.Bits(bits.packed, 13)
    assert len(pickle.dumps(big.to_dask(1))) < 20_000


def test_the_same_file_has_the_same_name(capture):
    first, second = (jl.open(capture).to_dask(8) for _ in range(2))
    assert first.name == second.name
    assert first.name != jl.open(capture)[1:].to_dask(8).name


def test_a_file_that_changed_is_refused(capture):
    lazy_bits = jl.open(capture).to_dask()
    packed = np.load(capture)
    np.save(capture, packed[:20])
    with pytest.raises((OSError, ValueError), match="changed"):
        lazy_bits.compute()


def test_copies_in_a_process_share_the_files_that_they_open(capture, monkeypatch):
    monkeypatch.setattr(lazy, "_COPIES", {})
    text = pickle.dumps(lazy.FrameSource(jl.open(capture).packed, "first"))
    expected = np.asarray(jl.open(capture).packed)
    np.testing.assert_array_equal(pickle.loads(text)[:], expected)
    first = lazy._COPIES["first"]
    np.testing.assert_array_equal(pickle.loads(text)[:], expected)
    assert lazy._COPIES["first"] is first
    for number in range(4):
        pickle.loads(pickle.dumps(lazy.FrameSource(jl.open(capture).packed, str(number))))[0]
    assert len(lazy._COPIES) == 4
    assert "first" not in lazy._COPIES


def test_a_file_that_changed_gets_another_copy(capture, monkeypatch):
    monkeypatch.setattr(lazy, "_COPIES", {})
    first = pickle.loads(pickle.dumps(jl.open(capture).to_dask(8)))
    packed = np.load(capture)
    np.testing.assert_array_equal(first.compute(scheduler="sync"), packed)
    np.save(capture, packed[::-1])
    second = pickle.loads(pickle.dumps(jl.open(capture).to_dask(8)))
    np.testing.assert_array_equal(second.compute(scheduler="sync"), packed[::-1])
    with pytest.raises((OSError, ValueError), match="changed"):
        first.compute(scheduler="sync")


def test_frames_that_are_decoded_are_read():
    frames = Frames((10, 2, 3), lambda a, b: np.full((b - a, 2, 3), 7, np.uint8))
    assert jl.Bits(frames).to_dask(4).compute().tolist() == [[[7] * 3] * 2] * 10


@pytest.mark.parametrize(
    ("chunks", "error", "message"),
    [
        ("11B", ValueError, "expected at least 12 bytes, which is one frame"),
        ("much", ValueError, "expected a size such as"),
        (0, ValueError, "1 frame or more"),
        (2.5, TypeError, "a number of frames, or a shape"),
        (True, TypeError, "a number of frames, or a shape"),
        ((7, 3, 2), ValueError, r"expected whole frames, such as \(100, -1, -1\)"),
        ((7, -1), ValueError, "expected whole frames"),
    ],
)
def test_chunks_without_whole_frames_are_refused(capture, chunks, error, message):
    with pytest.raises(error, match=message):
        jl.open(capture).to_dask(chunks)


def test_without_dask_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.array", None)
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[dask\]'"):
        lazy.import_dask_array()


@pytest.mark.slow
def test_dask_is_imported_only_if_it_is_requested():
    code = (
        "import sys, jotlight, jotlight.cli.app\n"
        "names = {'dask', 'distributed', 'zarr', 'fsspec'} & set(sys.modules)\n"
        "assert not names, names"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("key", [slice(None), slice(40, 3, -4), (slice(2, 9), slice(4, 1, -1))])
def test_copies_of_a_map_map_its_file_again(capture, key, monkeypatch):
    part = np.load(capture, mmap_mode="r")[key]
    with monkeypatch.context() as patch:
        patch.setattr("dask.array.core.tokenize", pytest.fail)  # it reads the whole map
        x = jl.Bits(part, 13).to_dask(3)
    np.testing.assert_array_equal(x.compute(), part)
    assert jl.Bits(part, 13).to_dask(3).name == x.name
    monkeypatch.setattr(lazy, "_COPIES", {})
    content = pickle.dumps(x)
    assert b"capture.npy" in content
    np.testing.assert_array_equal(pickle.loads(content).compute(), part)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(pickle.loads(content))), part)
    np.save(capture, np.zeros((50, 6, 2), np.uint8))
    monkeypatch.setattr(lazy, "_COPIES", {})
    with pytest.raises(OSError, match=r"capture\.npy: the file has changed"):
        pickle.loads(content).compute()


def test_threads_open_the_files_of_their_copies_once(monkeypatch):
    monkeypatch.setattr(lazy, "_COPIES", {})
    opened = []

    def open_slowly():
        opened.append(1)
        time.sleep(0.01)
        return Frames((10, 2, 3), lambda a, b: np.full((b - a, 2, 3), 7, np.uint8))

    frames = lazy._UnopenedFrames("a", (10, 2, 3), np.dtype(np.uint8), open_slowly, ())
    with ThreadPoolExecutor(4) as threads:
        parts = list(threads.map(lambda start: frames.map(start, start + 1), range(8)))
    assert np.array(parts).shape == (8, 1, 2, 3)
    assert len(opened) == 1


def test_copies_open_their_files_when_they_are_read(capture, monkeypatch):
    # An error while a message is unpickled would end a worker of dask, and not its task.
    monkeypatch.setattr(lazy, "_COPIES", {})
    text = pickle.dumps(jl.dask.count(jl.open(capture), window=5))
    capture.unlink()
    again = pickle.loads(pickle.dumps(pickle.loads(text)))
    assert again.shape == (10, 6, 13)
    with pytest.raises(FileNotFoundError, match=r"capture\.npy"):
        again.compute(scheduler="sync")


@pytest.mark.parametrize("mode", ["r+", "c"])
def test_a_map_that_this_process_may_change_is_copied(capture, mode):
    part = np.load(capture, mmap_mode=mode)[3:]
    part[0] = 255
    x = jl.Bits(part, 13).to_dask(10)
    capture.unlink()
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(x)).compute(), part)
