"""Frames with one bit in each number: requested, detected, and refused."""

import gzip

import h5py
import numpy as np
import pytest
import tifffile

import jotlight as jl
from examples.arrays import random_frames
from examples.encodings import npy_bytes
from jotlight.formats.reading import open_capture


@pytest.mark.parametrize("white", [1, 255])
@pytest.mark.parametrize("shape", [(9, 5, 13), (4, 5, 16, 3)])
@pytest.mark.parametrize("ending", ["npy", "npy.gz", "npz", "h5", "zarr", "tif"])
def test_unpacked_frames_are_bits_on_request(tmp_path, white, shape, ending):
    array = random_frames(shape)
    path, levels = tmp_path / f"a.{ending}", array.astype(np.uint8) * white
    if ending == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file["a"] = levels
    elif ending == "zarr":
        zarr = pytest.importorskip("zarr")
        zarr.open_array(str(path), mode="w", shape=shape, dtype=np.uint8)[...] = levels
    elif ending == "tif":
        tifffile.imwrite(path, levels, photometric="rgb" if len(shape) == 4 else "minisblack")
    elif ending == "npz":
        np.savez(path, a=levels)
    else:
        path.write_bytes(
            gzip.compress(npy_bytes(levels)) if ending == "npy.gz" else npy_bytes(levels)
        )
    bits = jl.open(path, unpacked=True)
    assert isinstance(bits, jl.Bits)
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(jl.open(path, unpacked=True, rotate=180)[1:].counts(1),
                                  array[1:, ::-1, ::-1].sum(0))  # fmt: skip
    if ending in ("npy", "npy.gz", "h5", "zarr"):
        with pytest.raises(ValueError, match=f"nothing but 0 and {white}, .*--unpacked"):
            jl.open(path, counts=False)
        assert jl.open(path, counts=False, unpacked=False).shape[2] == 8 * shape[2]


def test_frames_that_look_packed_are_accepted(tmp_path):
    dark = np.zeros((50, 6, 5), np.uint8)
    dark[:, 2, 1] = 1  # a hot jot, the last of its byte
    for cube in (dark, dark * 0, dark * 0 + 255, np.packbits(random_frames((5, 6, 40)), axis=2)):
        np.save(tmp_path / "a.npy", cube)
        np.testing.assert_array_equal(jl.open(tmp_path / "a.npy").packed, cube)
    jl.save(jl.Bits(np.tile(np.uint8([0, 1]), (2, 9, 9)), 144), tmp_path / "a.npy")
    assert jl.open(tmp_path / "a.npy").shape == (2, 9, 144)


def test_frames_after_dark_ones_are_inspected_too(tmp_path):
    light = np.zeros((3 << 8, 64, 64), np.uint8)
    light[384, :2, :8] = 1
    np.save(tmp_path / "a.npy", light)
    with pytest.raises(ValueError, match=r"nothing but 0 and 1, .*--unpacked"):
        jl.open(tmp_path / "a.npy")
    light[-1, 5, 5] = 2
    light[384, :2, 2:] = 0
    light[-1, :2, :8] = 1
    np.save(tmp_path / "a.npy", light)
    assert jl.open(tmp_path / "a.npy").shape == (768, 64, 512)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"counts": True}, r"counts: expected at most one .*\(--counts, --unpacked\)"),
        ({"format": "spad512s"}, "unpacked: is for bits in arrays"),
    ],
)
def test_unpacked_applies_only_to_bits_in_arrays(tmp_path, options, message):
    np.save(tmp_path / "a.npy", np.ones((2, 3, 4), np.uint8))
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "a.npy", unpacked=True, **options)
    np.save(tmp_path / "a.npy", np.full((2, 3, 4), 7, np.uint8))
    with pytest.raises(ValueError, match="expected bits, 0 and 1 only, got 7 to 7"):
        jl.open(tmp_path / "a.npy", unpacked=True).counts(1)


def test_counts_are_not_taken_for_packed_bits(tmp_path):
    counts = np.random.default_rng(0).binomial(16, 0.2, (6, 32, 40)).astype(np.uint8)
    np.save(tmp_path / "counts.npy", counts)
    with pytest.raises(ValueError, match=r"at most \d+, as in images of counts; pass counts=True"):
        jl.open(tmp_path / "counts.npy")
    with pytest.warns(jl.JotlightWarning, match="sum of its 6 images"):
        opened = jl.open(tmp_path / "counts.npy", counts=True)
    np.testing.assert_array_equal(opened, counts.sum(0))
    assert jl.open(tmp_path / "counts.npy", unpacked=False).shape == (6, 32, 320)


@pytest.mark.parametrize("options", [{}, {"unpacked": True}])
def test_frames_along_the_last_axis_are_reported(tmp_path, options):
    array = np.moveaxis(random_frames((8, 128, 100)), 0, 2)
    np.save(tmp_path / "hwt.npy", array if not options else array.astype(np.uint8))
    with pytest.warns(jl.JotlightWarning, match=r"hwt.npy: read as 128 frames of 100 x 8 jots"):
        jl.open(tmp_path / "hwt.npy", **options)


@pytest.mark.parametrize("ending", ["npy", "h5", "tif"])
def test_counts_along_the_last_axis_are_reported_unless_the_file_states_them(tmp_path, ending):
    counts = np.random.default_rng(0).binomial(300, 0.2, (128, 100, 8)).astype(np.uint16)
    path = tmp_path / f"hwt.{ending}"
    if ending == "npy":
        np.save(path, counts)
    elif ending == "h5":
        with h5py.File(path, "w") as file:
            file["x"] = counts
    else:
        tifffile.imwrite(path, counts)
    message = r"hwt\.\w+: read as 128 frames of 100 x 8 jots; if these are 8 frames of 128 x 100"
    with pytest.warns(jl.JotlightWarning, match=message):
        assert open_capture(path).images.shape == counts.shape
    sensor = jl.Sensor(frames=128, bit_depth=9)
    if ending != "h5":
        jl.save(jl.Readings(counts, sensor), tmp_path / f"own.{ending}")
        assert jl.open(tmp_path / f"own.{ending}").shape == counts.shape


@pytest.mark.parametrize("white", [1, 255])
@pytest.mark.parametrize("dtype", [np.float16, np.float64])
def test_floats_of_two_values_are_bits_on_request(tmp_path, dtype, white):
    frames = random_frames((4, 6, 20))
    np.save(tmp_path / "a.npy", frames.astype(dtype) * white)
    with pytest.raises(
        ValueError, match=r"got float\d\d of shape .* bits of 0 and 1, .*--unpacked"
    ):
        jl.open(tmp_path / "a.npy")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npy", unpacked=True).to_array(), frames)


@pytest.mark.parametrize("value", [0.5, np.nan, -1.0])
def test_other_floats_are_no_bits(tmp_path, value):
    frames = random_frames((4, 6, 20)).astype(float)
    frames[2, 3, 4] = value
    np.save(tmp_path / "a.npy", frames)
    with pytest.raises(ValueError, match="expected bits, 0 and 1 only, got"):
        jl.open(tmp_path / "a.npy", unpacked=True).to_array()


@pytest.mark.parametrize(
    ("shape", "advice"),
    [((4, 1, 6, 20), r"array\[:, 0\]"), ((1, 4, 6, 20), r"array\[0\]"), ((2, 4, 6, 20), "a list")],
)
@pytest.mark.parametrize("options", [{}, {"unpacked": True}, {"unpacked": False}])
def test_frames_of_more_than_four_channels_are_refused(tmp_path, shape, advice, options):
    frames = np.zeros(shape, np.uint8 if options else bool)
    np.save(tmp_path / "a.npy", frames)
    with pytest.raises(ValueError, match=f"at most 4 channels.*{advice}|write each channel"):
        jl.open(tmp_path / "a.npy", **options)
