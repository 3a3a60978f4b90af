"""Writing photon cubes: the files that appear, replace others, or are left alone."""

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_bits
from folders import file_names
from jotlight.formats.writing import write_capture
from jotlight.sensing.bits.frames import Frames


@pytest.mark.parametrize("shape", [(3, 5, 16), (1, 1, 1), (2, 4, 13), (4, 3, 9, 3)])
def test_numpy_alone_reads_the_files(tmp_path, shape):
    bits = random_bits(shape)
    jl.save(bits, tmp_path / "cube.npy")
    packed = np.load(tmp_path / "cube.npy", allow_pickle=False)
    unpacked = np.unpackbits(packed, axis=2, count=shape[2])
    np.testing.assert_array_equal(unpacked, bits.to_array())


@pytest.mark.parametrize("width", range(9, 17))
def test_the_true_width_is_kept(tmp_path, width):
    bits = random_bits((2, 3, width))
    jl.save(bits, tmp_path / "cube.npy")
    loaded = jl.open(tmp_path / "cube.npy")
    assert loaded.shape == (2, 3, width)
    np.testing.assert_array_equal(loaded.to_array(), bits.to_array())


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(oversampling=2, frames=3, gain=7.5, threshold=2, kernel="cubic", efficiency=0.3),
        jl.Sensor(frames=3, dark_counts=0.25, max_intensity=4.0),
        jl.Sensor(frames=3, mask=np.eye(4, 10, dtype=bool)),
        jl.Sensor(oversampling=2, frames=3, dark_counts=np.linspace(0, 1, 40).reshape(4, 10)),
        jl.Sensor(
            frames=3, dark_counts=np.linspace(0, 1, 40).reshape(4, 10), mask=np.eye(4, 10) > 0
        ),
    ],
    ids=repr,
)
def test_the_sensor_and_its_maps_are_kept(tmp_path, sensor):
    jl.save(random_bits((3, 4, 10), sensor), tmp_path / "cube.npy")
    assert jl.open(tmp_path / "cube.npy").sensor == sensor
    assert set(file_names(tmp_path)) == {
        "cube.npy",
        "cube.json",
        *(f"cube.{name}.npy" for name in sensor.maps()),
    }


def test_a_cube_and_its_companions_can_be_moved_together(tmp_path):
    sensor = jl.Sensor(mask=np.eye(4, dtype=bool))
    (tmp_path / "a").mkdir()
    jl.save(random_bits((1, 4, 4), sensor), tmp_path / "a" / "cube.npy")
    (tmp_path / "a").rename(tmp_path / "b")
    assert jl.open(tmp_path / "b" / "cube.npy").sensor == sensor


def test_bits_can_be_saved_over_the_file_they_are_read_from(tmp_path):
    bits = random_bits((3, 4, 10))
    jl.save(bits, tmp_path / "cube.npy")
    jl.save(jl.open(tmp_path / "cube.npy")[:2], tmp_path / "cube.npy")
    np.testing.assert_array_equal(jl.open(tmp_path / "cube.npy").to_array(), bits.to_array()[:2])


def test_file_names_with_dots_do_not_collide(tmp_path):
    first, second = random_bits((1, 2, 9), seed=1), random_bits((1, 2, 10), seed=2)
    jl.save(first, tmp_path / "run.1.npy")
    jl.save(second, tmp_path / "run.2.npy")
    assert jl.open(tmp_path / "run.1.npy").width == 9
    assert jl.open(tmp_path / "run.2.npy").width == 10


def test_files_that_jotlight_wrote_are_overwritten(tmp_path):
    jl.save(random_bits((1, 2, 9)), tmp_path / "cube.npy")
    bits = random_bits((2, 3, 17), jl.Sensor(frames=2))
    jl.save(bits, tmp_path / "cube.npy")
    loaded = jl.open(tmp_path / "cube.npy")
    np.testing.assert_array_equal(loaded.to_array(), bits.to_array())
    assert loaded.sensor == bits.sensor


def test_a_cube_and_its_compressed_copy_have_separate_descriptions(tmp_path):
    first = random_bits((3, 4, 13), jl.Sensor(frames=3, mask=np.eye(4, 13, dtype=bool)), seed=1)
    second = random_bits((2, 5, 10), jl.Sensor(frames=2, dark_counts=np.ones((5, 10))), seed=2)
    jl.save(first, tmp_path / "cube.npy")
    write_capture(second, tmp_path / "cube.npy.gz", "npy.gz")
    jl.save(first, tmp_path / "cube.npy")
    for name, bits in (("cube.npy", first), ("cube.npy.gz", second)):
        again = jl.open(tmp_path / name)
        np.testing.assert_array_equal(again.to_array(), bits.to_array())
        assert again.sensor == bits.sensor
    assert {"cube.json", "cube.npy.gz.json", "cube.npy.gz.dark_counts.npy"} < set(
        file_names(tmp_path)
    )
    (tmp_path / "cube.npy.gz.json").unlink()
    assert jl.open(tmp_path / "cube.npy.gz").sensor is None  # cube.json belongs to cube.npy


def test_only_the_latest_conversions_are_remembered(tmp_path):
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 2), np.uint8))
    for _ in range(40):
        jl.save(jl.open(tmp_path / "cube.npy"), tmp_path / "cube.npy")
    provenance = jl.open(tmp_path / "cube.npy").provenance
    assert provenance.describe()[0] == "npy: converted from cube.npy"
    assert 10 < len(provenance.describe()) < 20


@pytest.mark.parametrize("before", [False, True])
def test_an_interrupted_save_leaves_the_previous_files(tmp_path, before):
    old = random_bits((1, 2, 9))
    if before:
        jl.save(old, tmp_path / "cube.npy")
    there = file_names(tmp_path)

    def read(start, stop):
        assert any(path.name.startswith(".cube") for path in tmp_path.iterdir())
        raise KeyboardInterrupt

    bits = jl.Bits(Frames((1, 4, 1), read), 8, jl.Sensor(mask=np.eye(4, 8, dtype=bool)))
    with pytest.raises(KeyboardInterrupt):
        jl.save(bits, tmp_path / "cube.npy")
    assert file_names(tmp_path) == there
    if before:
        np.testing.assert_array_equal(jl.open(tmp_path / "cube.npy").to_array(), old.to_array())


def test_a_failed_save_leaves_no_files(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        jl.save(random_bits((1, 2, 8)), tmp_path / "missing" / "cube.npy")
    with pytest.raises(ValueError, match="implies no single format"):
        jl.save(random_bits((1, 2, 8)), tmp_path / "cube.bin")
    (tmp_path / "cube.mask.npy").mkdir()
    with pytest.raises(IsADirectoryError):
        jl.save(
            random_bits((1, 2, 8), jl.Sensor(mask=np.zeros((2, 8), bool))), tmp_path / "cube.npy"
        )
    assert file_names(tmp_path) == ["cube.mask.npy"]


def test_a_map_that_jotlight_did_not_write_is_never_overwritten(tmp_path):
    stranger = tmp_path / "capture.mask.npy"
    np.save(stranger, np.arange(3))
    sensor = jl.Sensor(mask=np.zeros((4, 8), bool))
    bits = jl.Bits.from_array(np.ones((1, 4, 8), bool), sensor)
    with pytest.raises(FileExistsError, match=r"capture\.mask\.npy would be overwritten"):
        jl.save(bits, tmp_path / "capture.npy")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture.mask.npy"]
    assert np.load(stranger).tolist() == [0, 1, 2]
    stranger.unlink()
    jl.save(bits, tmp_path / "capture.npy")
    jl.save(bits, tmp_path / "capture.npy")
    assert jl.open(tmp_path / "capture.npy").sensor == sensor
