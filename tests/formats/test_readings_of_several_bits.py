"""Files of readings of several bits: those of jotlight, plain stacks, and cubes of visionsim."""

import json

import numpy as np
import pytest
import tifffile

import jotlight as jl

RNG = np.random.default_rng(0)


def some_readings(bit_depth, **changes):
    sensor = jl.Sensor(**{"frames": 4, "bit_depth": bit_depth, "read_noise": 0.3, **changes})
    return jl.Readings(RNG.integers(0, 2**bit_depth, (sensor.frames, 6, 9)), sensor)


@pytest.mark.parametrize("name", ["a.npy", "a.tif"])
@pytest.mark.parametrize("bit_depth", [2, 8, 9, 16])
@pytest.mark.parametrize("frames", [1, 4])
def test_files_keep_readings_and_their_sensor(tmp_path, name, bit_depth, frames):
    readings = some_readings(bit_depth, frames=frames)
    jl.save(readings, tmp_path / name)
    opened = jl.open(tmp_path / name)
    np.testing.assert_array_equal(opened.to_array(), readings.to_array())
    assert opened.sensor == readings.sensor
    assert "readings of" in str(opened.provenance.notes)
    read = tifffile.imread if name == "a.tif" else np.load
    assert read(tmp_path / name).dtype == (np.uint8 if bit_depth <= 8 else np.uint16)
    assert jl.open(tmp_path / name, frames=slice(0, 1)).sensor.frames == 1


def test_maps_brackets_and_colors_are_kept(tmp_path):
    dark = RNG.random((6, 9)).astype(np.float32)
    readings = some_readings(4, gain=[1.0, 8.0, 1.0, 8.0], dark_counts=dark)
    jl.save(readings, tmp_path / "a.npy")
    opened = jl.open(tmp_path / "a.npy", frames=slice(1, 3), flip="horizontal")
    assert opened.sensor.gain.tolist() == [8.0, 1.0]
    np.testing.assert_array_equal(opened.sensor.dark_counts, dark[:, ::-1])
    np.testing.assert_array_equal(opened.to_array(), readings.to_array()[1:3, :, ::-1])
    with pytest.raises(ValueError, match="no place for the maps"):
        jl.save(readings, tmp_path / "a.tif")
    with pytest.raises(ValueError, match="npz: has no place for readings of several bits"):
        jl.save(readings, tmp_path / "a.npz")
    color = jl.Readings(RNG.integers(0, 16, (4, 6, 9, 3)), jl.Sensor(frames=4, bit_depth=4))
    for name in ("c.npy", "c.tif"):
        jl.save(color, tmp_path / name)
        np.testing.assert_array_equal(jl.open(tmp_path / name).to_array(), color.to_array())


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int64])
def test_plain_stacks_are_readings_if_the_caller_says_so(tmp_path, kind):
    array = RNG.integers(0, 16, (4, 6, 9)).astype(kind)
    np.save(tmp_path / "a.npy", array)
    np.savez(tmp_path / "a.npz", array)
    if kind != np.int64:
        tifffile.imwrite(tmp_path / "a.tif", array, photometric="minisblack")
    for path in tmp_path.iterdir():
        opened = jl.open(path, bit_depth=4)
        np.testing.assert_array_equal(opened.to_array(), array)
        assert opened.sensor == jl.Sensor(frames=4, bit_depth=4)
    with pytest.raises(ValueError, match="expected 0 to 3 for 2 bits"):
        jl.open(tmp_path / "a.npy", bit_depth=2).to_array()
    with pytest.raises(ValueError, match="bit_depth: expected a whole number from 2 to 16"):
        jl.open(tmp_path / "a.npy", bit_depth=1)


def test_files_are_read_when_they_are_needed_and_checked(tmp_path):
    readings = some_readings(4)
    jl.save(readings, tmp_path / "a.npy")
    content = bytearray((tmp_path / "a.npy").read_bytes())
    content[-1] ^= 1
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(ValueError, match="is damaged or was changed"):
        jl.open(tmp_path / "a.npy")
    text = json.loads((tmp_path / "a.json").read_text())
    del text["checksum"], text["sha256"]
    text["sensor"]["bit_depth"] = 2
    (tmp_path / "a.json").write_text(json.dumps(text))
    with pytest.raises(ValueError, match=r"readings: expected 0 to 3 for 2 bits"):
        jl.open(tmp_path / "a.npy").to_array()
    text["sensor"] = None
    (tmp_path / "a.json").write_text(json.dumps(text))
    with pytest.raises(ValueError, match="expected the sensor of the readings, got none"):
        jl.open(tmp_path / "a.npy")


def write_cube(folder, array):
    folder.mkdir()
    frames, height, width, *_ = array.shape
    np.save(folder / "frames.npy", array)
    content = {"w": width, "h": height, "c": 1, "bitpack": False, "file_path": "frames.npy"}
    (folder / "transforms.json").write_text(json.dumps({**content, "frames": [{}] * frames}))
    return folder


@pytest.mark.parametrize("bit_depth", [2, 3, 5])
def test_cubes_of_visionsim_are_sums_of_single_bits(tmp_path, bit_depth):
    # visionsim adds 2^b - 1 single bits, and stores their mean times 255, rounded down.
    planes = 2**bit_depth - 1
    counts = RNG.binomial(planes, 0.4, (5, 12, 14))
    stored = (255 * (counts / planes)).astype(np.uint8)
    folder = write_cube(tmp_path / "set", stored[..., None])
    with pytest.warns(jl.JotlightWarning, match="sum of its 5 images"):
        np.testing.assert_array_equal(jl.open(folder), counts.sum(axis=0))
    assert jl.open(folder, frames=slice(0, 2)).max() <= 2 * planes


def test_the_bits_of_each_value_of_a_cube_can_be_stated(tmp_path):
    counts = np.full((1, 6, 8), 7)
    folder = write_cube(tmp_path / "set", (255 * (counts / 15)).astype(np.uint8))
    found = jl.open(folder, counts_scale=255, trials=15, frames=slice(None))
    np.testing.assert_array_equal(found, counts[0])
