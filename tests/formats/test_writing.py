"""`jotlight.save`: bits and counts in the format that the extension implies."""

import json

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_bits, random_frames
from folders import file_names
from jotlight.sensing.bits.frames import Frames

COUNTS = np.random.default_rng(0).integers(0, 300, (6, 9))
SENSOR = jl.Sensor(oversampling=2, frames=3, mask=np.eye(4, 6, dtype=bool))
BITS = SENSOR.expose(np.full((2, 3), 0.5), rng=0)


@pytest.mark.parametrize("name", ["a.npy", "a.npy.gz"])
def test_saved_bits_are_read_back(tmp_path, name):
    bits = random_bits((3, 5, 13), jl.Sensor(frames=3))
    jl.save(bits, tmp_path / name)
    again = jl.open(tmp_path / name)
    np.testing.assert_array_equal(again.to_array(), bits.to_array())
    assert again.sensor == bits.sensor


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.tif", "a.png"])
@pytest.mark.parametrize("dtype", [np.int64, np.uint16])
def test_saved_counts_are_read_back(tmp_path, name, dtype):
    jl.save(COUNTS.astype(dtype), tmp_path / name)
    np.testing.assert_array_equal(jl.open(tmp_path / name), COUNTS)


@pytest.mark.parametrize("name", ["a.npz", "a.tif", "a.png"])
def test_a_format_of_counts_warns_that_only_the_sum_is_saved(tmp_path, name):
    bits = random_bits((3, 5, 13))
    with pytest.warns(jl.JotlightWarning, match="only the sum of the 3 frames is saved; save to"):
        jl.save(bits, tmp_path / name)
    np.testing.assert_array_equal(jl.open(tmp_path / name), bits.counts(1))
    jl.save(bits[:1], tmp_path / name)


def test_the_format_can_be_named(tmp_path):
    frames = random_frames((2, 256, 512))
    jl.save(jl.Bits.from_array(frames), tmp_path / "a.bin", format="swissspad2")
    bits = jl.open(tmp_path / "a.bin", format="swissspad2")
    np.testing.assert_array_equal(bits.to_array(), frames)


@pytest.mark.parametrize("data", [[[True]], np.ones((2, 2)), np.ones((1, 2, 2), bool)])
def test_only_bits_and_integers_are_saved(tmp_path, data):
    with pytest.raises(TypeError, match=r"expected jotlight\.Bits or an array of counts"):
        jl.save(data, tmp_path / "a.npy")


@pytest.mark.parametrize("data", [np.array([[-1]]), np.array([[2**31]]), np.ones(3, np.int32)])
def test_impossible_counts_are_not_saved(tmp_path, data):
    with pytest.raises(ValueError, match="data: expected counts"):
        jl.save(data, tmp_path / "a.npy")
    assert list(tmp_path.iterdir()) == []


def test_saved_bits_are_opened_with_their_width_and_sensor(tmp_path):
    jl.save(BITS, tmp_path / "capture.npy")
    opened = jl.open(tmp_path / "capture.npy")
    assert (opened.shape, opened.sensor) == (BITS.shape, SENSOR)
    np.testing.assert_array_equal(opened.to_array(), BITS.to_array())


def test_any_program_can_unpack_the_file(tmp_path):
    jl.save(BITS, str(tmp_path / "capture.npy"))
    packed = np.load(tmp_path / "capture.npy")
    np.testing.assert_array_equal(np.unpackbits(packed, axis=2, count=6), BITS.to_array())
    description = json.loads((tmp_path / "capture.json").read_text())
    assert description["maps"]["mask"]["file"] == "capture.mask.npy"
    np.testing.assert_array_equal(np.load(tmp_path / "capture.mask.npy"), SENSOR.mask)


def test_the_provenance_is_saved_and_becomes_the_origin(tmp_path):
    jl.save(BITS, tmp_path / "first.npy")
    jl.save(jl.open(tmp_path / "first.npy")[:2], tmp_path / "second.npy")
    origin = jl.open(tmp_path / "second.npy").provenance.origin
    assert (origin.name, origin.notes) == ("first.npy", ("frames 0:2 of 3",))


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (np.full((2, 3), 0.5), r"float64; jotlight\.save_image\("),
        (np.ones((2, 3), bool), r"bool; jotlight\.Bits\.from_array\(frames, sensor\)"),
        (jl.Network.initial(jl.Sensor()), "Network; their own method save"),
        ("capture.npy", "str$"),
        (None, "NoneType$"),
    ],
)
def test_what_is_neither_bits_nor_counts_is_refused(tmp_path, other, message):
    expected = r"data: expected jotlight\.Bits or an array of counts, got "
    with pytest.raises(TypeError, match=expected + message):
        jl.save(other, tmp_path / "capture.npy")
    assert not list(tmp_path.iterdir())


def test_masked_counts_are_refused(tmp_path):
    with pytest.raises(TypeError, match="data: expected a plain array, got a masked one"):
        jl.save(np.ma.ones((2, 3), int), tmp_path / "capture.npy")
    assert not list(tmp_path.iterdir())


def test_a_name_that_implies_no_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match="this name implies no single format"):
        jl.save(BITS, tmp_path / "capture.bin")
    with pytest.raises(ValueError, match=r"add an ending, such as \.npy, or pass format="):
        jl.save(BITS, tmp_path / "capture")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [".", "..", "old", "old.set"])
def test_a_folder_is_refused_with_the_name_of_a_file_in_it(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    for each in ("old", "old.set"):
        (tmp_path / each).mkdir()
    with pytest.raises(IsADirectoryError, match=r"it is a folder; name .*capture\.npy, or a new"):
        jl.save(BITS, name)


@pytest.mark.parametrize(
    "convert",
    [
        np.ndarray.tolist,
        lambda counts: pytest.importorskip("torch").from_numpy(counts),
        lambda counts: pytest.importorskip("dask.array").from_array(counts),
    ],
    ids=["list", "tensor", "dask"],
)
def test_counts_of_any_array_are_saved(tmp_path, convert):
    counts = np.arange(12, dtype=np.int32).reshape(3, 4)
    jl.save(convert(counts), tmp_path / "a.npy")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npy"), counts)


def test_frames_are_no_image_of_counts(tmp_path):
    with pytest.raises(ValueError, match=r"at most 4 channels, got shape \(4, 12, 14\); .* packs"):
        jl.save(np.ones((4, 12, 14), np.uint8), tmp_path / "a.npy")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("data", "kind"), [(None, "NoneType"), (jl.Sensor(), "Sensor"), ([[0.5]], "list")]
)
def test_the_error_of_other_data_names_their_type(tmp_path, data, kind):
    with pytest.raises(TypeError, match=f"data: expected .* an array of counts, got {kind}"):
        jl.save(data, tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("data", "advice"),
    [
        (np.full((2, 3), 4.0), r"write counts\.astype\(int\) for counts; jotlight\.save_image"),
        (np.full((2, 3), 0.5), r"got float64; jotlight\.save_image"),
        (np.full((2, 3), np.nan), r"got float64; jotlight\.save_image"),
        (jl.Merged([[3, 1]], [[4.0, 2.0]], jl.Sensor(frames=4)), r"numpy\.savez\(.*merged\.ones"),
        ([BITS, BITS], "got list; write each of them to a file of its own"),
        ([], r"or an array of counts, got list$"),
    ],
)
def test_the_error_of_other_data_says_what_writes_them(tmp_path, data, advice):
    with pytest.raises(TypeError, match=f"data: expected .*{advice}"):
        jl.save(data, tmp_path / "a.npy")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.npy", "a.bin", "a"])
def test_bits_that_do_not_fit_on_the_disk_are_refused_before_they_are_read(tmp_path, name):
    huge = jl.Bits(Frames((1 << 50, 256, 64), pytest.fail))
    with pytest.raises(OSError, match=r"the results need up to .* TiB, but .* free some space"):
        jl.save(huge, tmp_path / name, format=None if name == "a.npy" else "swissspad2")
    assert file_names(tmp_path) == []
