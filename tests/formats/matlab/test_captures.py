"""MATLAB files: parts, variables, and version 7.3."""

import hashlib
import json
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import jotlight as jl
from examples import read_or_refused
from examples.arrays import random_bits, random_frames
from jotlight.formats.capture import jot_shape
from jotlight.formats.matlab.files import open_mat
from jotlight.formats.reading import open_capture
from jotlight.formats.verification import verify_capture

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


def test_parts_are_read_in_natural_order(tmp_path):
    from scipy.io import savemat

    array = random_frames((23, 5, 7))
    for number, part in enumerate(np.array_split(array, 11)):
        name = tmp_path / f"part_{number + 1}.mat"
        savemat(name, {"OUTPUT": np.moveaxis(part, 0, 2).astype([np.uint8, float][number % 2])})
    bits = jl.open(tmp_path)
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits.counts(), array.sum(0))
    (tmp_path / "info.json").write_text('{"no_parts": 11, "no_frames": 20}')
    assert len(jl.open(tmp_path)) == 20
    (tmp_path / "info.json").write_text('{"no_parts": 12, "no_frames": 23}')
    with pytest.warns(jl.JotlightWarning, match="states 12 parts, but there are 11"):
        assert len(jl.open(tmp_path)) == 23


def test_variables_are_chosen_by_name(tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"x": COUNTS[0], "text": "words", "y": np.ones((2, 3), bool)})
    np.testing.assert_array_equal(jl.open(tmp_path / "a.mat", key="x", counts=True), COUNTS[0])
    savemat(tmp_path / "narrow.mat", {"x": COUNTS[0, :, :3]})
    np.testing.assert_array_equal(jl.open(tmp_path / "narrow.mat", counts=True), COUNTS[0, :, :3])
    assert jl.open(tmp_path / "a.mat", key="y").shape == (1, 2, 3)
    with pytest.raises(ValueError, match=r"key= \(--key\) to name one of its variables: x, y$"):
        jl.open(tmp_path / "a.mat")
    with pytest.raises(ValueError, match=r"0 and 1 only, got .*; counts=True \(--counts\) reads"):
        jl.open(tmp_path / "a.mat", key="x")  # before anyone compares the number of frames
    (tmp_path / "a.mat").write_bytes((tmp_path / "a.mat").read_bytes()[:150])
    with pytest.raises(ValueError, match=r"a\.mat"):
        jl.open(tmp_path / "a.mat", key="x").counts()


@pytest.mark.parametrize(
    "kind", ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"]
)
def test_counts_have_any_type_of_integers(tmp_path, kind):
    from scipy.io import savemat

    counts = np.minimum(COUNTS[0], 100).astype(kind)
    savemat(tmp_path / "a.mat", {"x": counts})
    np.testing.assert_array_equal(jl.open(tmp_path / "a.mat", counts=True), counts)


@pytest.mark.parametrize("kind", ["uint32", "int64", "uint64"])
def test_integers_that_are_no_counts_are_refused(tmp_path, kind):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"x": np.full((3, 4), np.iinfo(kind).max)})
    with pytest.raises(ValueError, match=r"a\.mat: expected counts from 0 to 2147483647, got"):
        jl.open(tmp_path / "a.mat", counts=True)


def test_threads_that_share_a_capture_load_it_one_at_a_time(tmp_path, monkeypatch):
    import scipy.io

    array = random_frames((23, 5, 7))
    scipy.io.savemat(tmp_path / "a.mat", {"OUTPUT": np.moveaxis(array, 0, 2).astype(np.uint8)})
    load, loading, most = scipy.io.loadmat, [], 0

    def load_slowly(*args, **options):
        nonlocal most
        loading.append(1)
        most = max(most, len(loading))
        time.sleep(0.002)
        array = load(*args, **options)
        loading.pop()
        return array

    monkeypatch.setattr("scipy.io.loadmat", load_slowly)
    frames = open_mat(tmp_path / "a.mat", None, None, None)
    parts = [(0, 23), (3, 9), (20, 23), (0, 5)] * 10
    with ThreadPoolExecutor(4) as threads:
        read = threads.map(lambda part: frames.read(*part), parts)
        for (start, stop), part in zip(parts, read, strict=True):
            np.testing.assert_array_equal(part, array[start:stop])
    assert most == 1


@pytest.mark.parametrize("options", [{}, {"counts": True}])
@pytest.mark.parametrize("shape", [(16, 64, 96), (300, 32, 32)])
def test_frames_along_the_first_axis_are_reported(tmp_path, shape, options):
    from scipy.io import savemat

    array = random_frames(shape).astype(np.uint8)
    savemat(tmp_path / "thw.mat", {"x": array})
    frames, height, width = shape
    message = (
        rf"thw\.mat: read as {width} frames of {frames} x {height} jots; if these are {frames} "
        rf"frames of {height} x {width} jots, move .* np\.moveaxis\(array, 0, 2\)"
    )
    with pytest.warns(jl.JotlightWarning, match=message):
        open_capture(tmp_path / "thw.mat", **options)
    savemat(tmp_path / "hwt.mat", {"x": np.moveaxis(array, 0, 2)})
    assert jot_shape(open_capture(tmp_path / "hwt.mat", **options)) == shape


@pytest.mark.parametrize("shape", [(1, 256, 1000), (4, 256, 300), (16, 256, 1000)])
def test_sensors_with_few_rows_are_not_suspected(tmp_path, shape):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"x": random_frames(shape).astype(np.uint8)})
    height, width, frames = shape
    assert jot_shape(open_capture(tmp_path / "a.mat")) == (frames, height, width)


def test_frames_of_parts_by_jotlight_are_not_suspected(tmp_path):
    bits = jl.Bits.from_array(random_frames((300, 16, 300)))
    jl.save(bits, tmp_path / "parts", format="matlab")
    np.testing.assert_array_equal(jl.open(tmp_path / "parts").to_array(), bits.to_array())


def test_version_7_3_is_hdf5_with_reversed_dimensions(tmp_path):
    h5py = pytest.importorskip("h5py")
    array = random_frames((4, 5, 7))
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["OUTPUT"] = array.swapaxes(1, 2).astype(np.uint8)
        file.create_virtual_dataset("other", h5py.VirtualLayout((2, 3), "u1"))
    with (tmp_path / "a.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.mat").to_array(), array)
    with pytest.raises(ValueError, match=r"variables: OUTPUT, other \(virtual\); got 'none'"):
        jl.open(tmp_path / "a.mat", key="none")


def zipped_mat(path):
    """Write a compressed `.mat` as other software does, and return its bytes."""
    from scipy.io import savemat

    savemat(path, {"OUTPUT": np.eye(12, dtype=np.uint8).reshape(3, 4, 12), "z": np.arange(9)},
            do_compression=True)  # fmt: skip
    return path.read_bytes()


@pytest.mark.slow
def test_compressed_variables_are_checked_to_their_end(tmp_path):
    path = tmp_path / "a.mat"
    content = zipped_mat(path)
    expected = jl.open(path).to_array()
    damaged = [content[:length] for length in range(129, len(content), 5)]
    for bit in range(8 * 128, 8 * len(content), 9):
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        damaged.append(bytes(flipped))
    refused = 0
    for each in damaged:
        path.write_bytes(each)
        frames = read_or_refused(lambda path: jl.open(path).to_array(), path)
        refused += frames is None
        # A few bits fill the last byte of a stream, and the file can end after its first variable.
        assert frames is None or np.array_equal(frames, expected)
    assert refused > 0.95 * len(damaged)


def test_info_holds_checksums_and_the_numbers_that_other_software_reads(tmp_path):
    jl.save(random_bits((300, 4, 9)), tmp_path / "a", format="matlab")
    info = json.loads((tmp_path / "a" / "info.json").read_text())
    assert (info["no_parts"], info["no_frames"]) == (2, 300)
    for name, checksum in info["parts"].items():
        assert hashlib.sha256((tmp_path / "a" / name).read_bytes()).hexdigest() == checksum


@pytest.mark.parametrize("shape", [(3, 4, 9), (1, 5, 16), (300, 6, 7)])
def test_other_software_reads_the_parts(tmp_path, shape):
    from scipy.io import loadmat, whosmat

    bits = random_bits(shape)
    jl.save(bits, tmp_path / "a", format="matlab")
    parts = sorted((tmp_path / "a").glob("part_*.mat"))
    assert len(parts) == 1 + (shape[0] > 256)
    arrays = [loadmat(part)["OUTPUT"] for part in parts]
    assert {array.dtype for array in arrays} == {np.dtype(np.uint8)}
    np.testing.assert_array_equal(np.moveaxis(np.concatenate(arrays, 2), 2, 0), bits.to_array())
    assert whosmat(parts[-1]) == [("OUTPUT", arrays[-1].shape, "uint8")]


def test_a_part_is_much_smaller_than_its_frames(tmp_path):
    jl.save(jl.Bits.from_array(np.zeros((64, 64, 64), bool)), tmp_path / "a", format="matlab")
    assert (tmp_path / "a/part_1.mat").stat().st_size < 64**3 / 100


@pytest.mark.slow
def test_equal_frames_make_equal_files_at_any_time(tmp_path):
    bits = random_bits((3, 4, 9))
    for name in "ab":
        jl.save(bits, tmp_path / name, format="matlab")
        # The header of other software states the time in seconds.
        time.sleep(1.1)
    for name in ("part_1.mat", "info.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    np.testing.assert_array_equal(jl.open(tmp_path / "a").to_array(), bits.to_array())


def change(folder, **changes):
    """Change entries of `info.json` as a user does, who deletes its checksum."""
    info = json.loads((folder / "info.json").read_text())
    del info["checksum"]
    (folder / "info.json").write_text(json.dumps({**info, **changes}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"no_frames": 299}, "expected 299 frames, got 300"),
        ({"no_parts": 3}, "got 3 parts and a list of 2"),
        ({"parts": {"part_1.mat": "0"}}, "expected the parts that it lists"),
        ({"parts": {"part_1.mat": 0, "part_2.mat": 0}}, "expected checksums of all parts"),
        ({"parts": {"part_1.mat": "0", "part_2.mat": "0"}}, "part_1.mat: is damaged"),
        ({"extra": 1}, "unknown entries extra"),
        ({"version": 2}, "version 1"),
    ],
)
def test_an_info_that_does_not_fit_its_parts_is_refused(tmp_path, changes, message):
    jl.save(random_bits((300, 4, 9)), tmp_path / "a", format="matlab")
    change(tmp_path / "a")
    assert jl.open(tmp_path / "a").counts(1).max() > 0
    change_again = {**json.loads((tmp_path / "a" / "info.json").read_text()), **changes}
    (tmp_path / "a" / "info.json").write_text(json.dumps(change_again))
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "a").counts(1)


def test_a_missing_or_additional_part_is_refused(tmp_path):
    folder = tmp_path / "a"
    jl.save(random_bits((300, 4, 9)), folder, format="matlab")
    content = (folder / "part_2.mat").read_bytes()
    (folder / "part_3.mat").write_bytes(content)
    with pytest.raises(ValueError, match=r"info\.json: .*expected the parts that it lists"):
        jl.open(folder)
    (folder / "part_3.mat").unlink()
    (folder / "part_2.mat").unlink()
    with pytest.raises(ValueError, match=r"info\.json: .*expected the parts that it lists"):
        jl.open(folder)


@pytest.mark.parametrize(("bytes_", "parts"), [(1, 7), (2 * 3 * 13, 4), (1 << 26, 1)])
def test_the_parts_of_large_frames_have_fewer_frames(tmp_path, monkeypatch, bytes_, parts):
    monkeypatch.setattr("jotlight.formats.matlab.captures._BYTES_PER_PART", bytes_)
    bits = random_bits((7, 3, 13))
    jl.save(bits, tmp_path / "a", format="matlab")
    assert len(list((tmp_path / "a").glob("part_*.mat"))) == parts
    np.testing.assert_array_equal(jl.open(tmp_path / "a").to_array(), bits.to_array())


def test_verification_counts_the_parts_and_their_description(tmp_path, monkeypatch):
    monkeypatch.setattr("jotlight.formats.matlab.captures._BYTES_PER_PART", 1)
    jl.save(random_bits((3, 4, 13)), tmp_path / "a", format="matlab")
    assert verify_capture(tmp_path / "a").startswith("4 files match their checksums; all 3 frames")
    (tmp_path / "a" / "info.json").unlink()
    assert verify_capture(tmp_path / "a").startswith("there is no checksum apart from those inside")


def test_bits_of_several_channels_are_refused_with_their_number(tmp_path):
    bits = jl.Bits.from_array(np.zeros((2, 4, 5, 3), bool))
    with pytest.raises(ValueError, match=r"one channel, got 3; write to a name that ends in \.npy"):
        jl.save(bits, tmp_path / "folder", format="matlab")
    assert not list(tmp_path.iterdir())
