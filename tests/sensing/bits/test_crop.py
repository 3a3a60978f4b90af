"""Rows and columns of captures, with the sensor that has them."""

import pickle

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.bits.crop import Region, note_part, noted_region
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.provenance import Provenance

RNG = np.random.default_rng(0)
REGIONS = [
    (slice(None), slice(start, stop))
    for start in (0, 1, 5, 7, 8)
    for stop in (start + 1, start + 8, 29)
] + [(slice(3, 7),), (slice(-4, None), slice(-9, -2)), (slice(None), slice(None))]


def lazy(array):
    return Frames(array.shape, lambda a, b: array[a:b].copy(), array.dtype)


@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_region_of_bits_equals_that_of_the_array(channels):
    array = RNG.random((5, 8, 29, *channels)) < 0.5
    kept = jl.Bits.from_array(array)
    for bits in (kept, jl.Bits(lazy(kept.packed), 29)):
        for region in REGIONS:
            for frames in (slice(None), slice(1, 4), slice(None, None, -2)):
                index = (frames, *region)
                part = bits[index]
                np.testing.assert_array_equal(part.to_array(), array[index])
                assert part.shape == array[index].shape
                packed = np.asarray(part.packed)
                np.testing.assert_array_equal(packed, np.packbits(array[index], axis=2))
            np.testing.assert_array_equal(bits[(-2, *region)], array[(-2, *region)])
            np.testing.assert_array_equal(bits[:, *region][:2].counts(1), array[:2, *region].sum(0))


@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_region_of_readings_equals_that_of_the_array(channels):
    array = RNG.integers(0, 8, (5, 8, 29, *channels)).astype(np.uint16)
    sensor = jl.Sensor(frames=5, bit_depth=3)
    for frames in (array, lazy(array)):
        readings = jl.Readings(frames, sensor)
        for region in REGIONS:
            index = (slice(1, 4), *region)
            part = readings[index]
            np.testing.assert_array_equal(part.to_array(), array[index])
            assert part.sensor == sensor.replace(frames=3)
            np.testing.assert_array_equal(readings[(2, *region)], array[(2, *region)])
            np.testing.assert_array_equal(part.sum(), array[index].sum(axis=0))


MAPS = {
    "dark_counts": RNG.random((16, 24)) * 0.1,
    "efficiency": 0.5 + RNG.random((16, 24)) / 2,
    "mask": RNG.random((16, 24)) < 0.05,
}


@pytest.mark.parametrize("bit_depth", [1, 3])
def test_the_estimate_of_a_region_is_the_region_of_the_estimate(bit_depth):
    scene = RNG.random((8, 12)).astype(np.float32)
    sensor = jl.Sensor(frames=9, oversampling=2, bit_depth=bit_depth, max_intensity=4.0, **MAPS)
    data = sensor.expose(scene, rng=0)
    part = data[:, 4:14, 6:22]
    np.testing.assert_array_equal(part.sensor.mask, MAPS["mask"][4:14, 6:22])
    np.testing.assert_array_equal(jl.mle(part), jl.mle(data)[2:7, 3:11])


def test_a_map_of_thresholds_is_cropped():
    thresholds = 1 + np.indices((8, 12)).sum(axis=0) % 3
    sensor = jl.Sensor(frames=6, threshold=thresholds, max_intensity=4.0)
    bits = sensor.expose(RNG.random((8, 12)).astype(np.float32), rng=0)
    part = bits[2:, 1:6, 3:]
    np.testing.assert_array_equal(part.sensor.threshold, thresholds[1:6, 3:])
    np.testing.assert_array_equal(jl.mle(part), jl.mle(bits[2:])[1:6, 3:])


@pytest.mark.parametrize("mosaic", ["RGGB", "RGB", RNG.integers(0, 3, (24, 30))])
def test_the_mosaic_keeps_its_place(mosaic):
    mosaic = mosaic if isinstance(mosaic, str) else Mosaic(mosaic, "RGB")
    sensor = jl.Sensor(frames=4, oversampling=2, mosaic=mosaic)
    bits = sensor.expose(RNG.random((24, 30, 3)).astype(np.float32), rng=0)
    part = bits[:, 6:46, 2:58]
    expected = sensor.mosaic.full(24, 30)[3:23, 1:29]
    np.testing.assert_array_equal(part.sensor.mosaic.full(20, 28), expected)
    assert part.sensor.mosaic.filters == sensor.mosaic.filters


@pytest.mark.parametrize(
    ("index", "error", "message"),
    [
        (
            np.s_[:, 3:8],
            ValueError,
            "rows of whole pixels, .* multiples of 4 jots, got 3:8; take 0",
        ),
        (np.s_[:, :, 4:10], ValueError, "columns of whole pixels, .* got 4:10; take 4:12"),
        (np.s_[:, ::2], ValueError, "expected consecutive rows, such as 10:40, got ::2"),
        (np.s_[:, :, ::-1], ValueError, "expected consecutive columns"),
        (np.s_[:, 8:8], ValueError, "no rows in 8:8 of 16"),
        (np.s_[:, :, 30:], ValueError, "no columns in 30: of 24"),
        (np.s_[:, 4], TypeError, r"slices of rows and columns .* got 4; np\.asarray"),
        (np.s_[:, :4, 4:8, 0], TypeError, r"got :4, 4:8, 0; np\.asarray\({name}\) is an array"),
        (np.s_[:, ...], TypeError, "slices of rows and columns after the frames"),
        (np.s_[:, 2.0:4], TypeError, "whole numbers in the slice of rows, .* got 2.0:4$"),
        (np.s_[:, :, 4:"a"], TypeError, "whole numbers in the slice of columns, .* got 4:'a'$"),
        (np.s_[2.0:, :4], TypeError, "whole numbers in the slice of frames, .* got 2.0:$"),
        (np.s_[:, ::0], ValueError, "slice of rows with a step other than 0, got ::0"),
        (np.s_[5:, :4], ValueError, "no frames in 5: of 5"),
        (np.s_[9, :4], IndexError, "expected a frame from 0 to 4, got 9"),
    ],
)
@pytest.mark.parametrize("bit_depth", [1, 2])
def test_wrong_regions_are_refused(index, error, message, bit_depth):
    sensor = jl.Sensor(frames=5, oversampling=4, bit_depth=bit_depth)
    data = sensor.expose(np.full((4, 6), 0.5), rng=0)
    name = "bits" if bit_depth == 1 else "readings"
    with pytest.raises(error, match=message.replace("{name}", name)):
        data[index]


@pytest.mark.parametrize("bit_depth", [1, 2])
def test_a_file_is_read_only_when_its_region_is_needed(tmp_path, bit_depth):
    data = jl.Sensor(frames=20, bit_depth=bit_depth).expose(np.full((16, 24), 0.5), rng=0)
    jl.save(data, tmp_path / "a.npy")
    opened = jl.open(tmp_path / "a.npy")
    part = opened[4:12, 3:9, 5:20]
    frames = part.packed if bit_depth == 1 else part.frames
    assert isinstance(frames, Frames)
    read = []
    opened_again = pickle.loads(pickle.dumps(frames))
    assert isinstance(opened_again, Frames)
    original = opened_again._read
    opened_again._read = lambda a, b: read.append((a, b)) or original(a, b)
    expected = np.asarray(data)[4:12, 3:9, 5:20]
    first = opened_again[:2]
    assert read == []
    content = np.asarray(first)
    content = np.unpackbits(content, axis=2, count=15) if bit_depth == 1 else content
    np.testing.assert_array_equal(content, expected[:2])
    assert read == [(0, 2)]
    assert part.provenance.notes[-2:] == (
        "frames 4:12 of 20",
        "rows 3:9 and columns 5:20 of 16 x 24",
    )
    jl.save(part, tmp_path / "b.npy")
    np.testing.assert_array_equal(np.asarray(jl.open(tmp_path / "b.npy")), expected)


def test_lazy_arrays_of_dask_have_the_region(tmp_path):
    pytest.importorskip("dask")
    bits = jl.Sensor(frames=20).expose(np.full((16, 24), 0.5), rng=0)
    jl.save(bits, tmp_path / "a.npy")
    opened = jl.open(tmp_path / "a.npy")
    parts = [opened[:, 3:9, 5:20], opened[:, 3:9, 6:21]]
    arrays = [part.to_dask(chunks=7) for part in parts]
    assert arrays[0].name != arrays[1].name
    for part, array in zip(parts, arrays, strict=True):
        np.testing.assert_array_equal(array.compute(), np.asarray(part.packed))


def test_data_without_provenance_have_none_after_cropping():
    bits = jl.Bits.from_array(np.zeros((2, 4, 9), bool))
    assert bits[:, 1:].provenance is None
    bits.provenance = Provenance("npy", "a.npy")
    assert bits[:, :, :].provenance == bits.provenance


def test_the_region_of_a_converted_file_refers_to_the_original(tmp_path):
    jl.save(jl.Bits.from_array(np.zeros((2, 16, 24), bool)), tmp_path / "a.npy")
    part = jl.open(tmp_path / "a.npy")[:, 3:13, 5:23]
    jl.save(part, tmp_path / "b.npy")
    again = jl.open(tmp_path / "b.npy")
    assert noted_region(again.provenance) == (Region(range(3, 13), range(5, 23)), (16, 24))
    inner = again[:, 2:4, 1:]
    assert noted_region(inner.provenance) == (Region(range(5, 7), range(6, 23)), (16, 24))
    turned = jl.open(tmp_path / "b.npy", rotate=180)
    assert noted_region(turned.provenance) == (Region(range(3, 13), range(1, 19)), (16, 24))
    first = jl.open(tmp_path / "a.npy", rotate=180)[:, :4]
    assert noted_region(first.provenance) == (Region(range(4), range(24)), (16, 24))
    assert noted_region(jl.open(tmp_path / "a.npy").provenance) is None


@pytest.mark.parametrize("flips", [(None, "vertical"), ("horizontal", None), ("vertical",) * 2])
@pytest.mark.parametrize("turns", [(90, 0), (0, 270), (180, 90)])
def test_a_region_is_turned_along_with_its_frames(tmp_path, turns, flips):
    """The region that is noted has the bits of the file if the whole file is turned first."""
    bits = jl.Bits.from_array(np.random.default_rng(0).random((2, 16, 24)) < 0.5)
    jl.save(bits, tmp_path / "a.npy")
    part = jl.open(tmp_path / "a.npy", rotate=turns[0], flip=flips[0])[:, 3:13, 5:14]
    jl.save(part, tmp_path / "b.npy")
    turned = jl.open(tmp_path / "b.npy", rotate=turns[1], flip=flips[1])[:, 1:, :6]
    region, size = noted_region(turned.provenance)
    jl.save(jl.open(tmp_path / "a.npy", rotate=turns[0], flip=flips[0]), tmp_path / "c.npy")
    whole = jl.open(tmp_path / "c.npy", rotate=turns[1], flip=flips[1])
    assert whole.shape[1:] == size
    np.testing.assert_array_equal(whole[:, *region.slices].to_array(), turned.to_array())


def test_the_region_of_data_with_an_unknown_orientation_is_unknown():
    unknown = Provenance("npy", "a.npy", orientation=None)
    part = note_part(unknown, slice(2), Region(range(3), range(5)), (2, 8, 8))
    assert noted_region(part) is None
