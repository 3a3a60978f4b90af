"""Round trips of bits and counts through the formats that `jotlight convert` writes."""

from importlib.util import find_spec

import numpy as np
import pytest

import jotlight as jl
from conversions import BITS, COUNTS, NEEDS, files, path_for, random_frames
from jotlight.formats.registry import WRITERS
from jotlight.formats.writing import choose_output_format, write_capture
from reference import formats

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    """Return a folder with five frames in every format that is written."""
    folder = tmp_path_factory.mktemp("captures")
    for name in BITS:
        if name in NEEDS and find_spec(NEEDS[name]) is None:
            continue
        bits = jl.Bits.from_array(random_frames(5, 256 if name == "swissspad2" else 512, 512))
        write_capture(bits, path_for(folder, name, name), name)
    return folder


def pairs(names):
    """Return pairs in which each format is read and written: with itself, and with `.npy`."""
    return sorted({pair for name in names for pair in ((name, name), (name, "npy"), ("npy", name))})


SHORT = [("swissspad2", name) for name in BITS if WRITERS[name].extensions == (".bin",)]
"""Pairs with frames of 256 rows, which the other formats of `.bin` refuse."""


@pytest.mark.parametrize(("first", "second"), sorted({*pairs(BITS), *SHORT}))
def test_bits_survive_conversions(captures, tmp_path, first, second):
    for name in (first, second):
        pytest.importorskip(NEEDS.get(name, "numpy"))
    bits = jl.open(path_for(captures, first, first), format=first)
    cut = "swissspad2" in (first, second) and first != second
    if cut and WRITERS[second].extensions == (".bin",):
        with pytest.raises(ValueError, match="expected frames of"):
            write_capture(bits, path_for(tmp_path, second), second)
        assert files(tmp_path) == []
        return
    write_capture(bits, path_for(tmp_path, second), second)
    reopened = jl.open(path_for(tmp_path, second), format=second)
    expected = random_frames(5, 256 if first == "swissspad2" else 512, 512)
    np.testing.assert_array_equal(reopened.to_array(), expected)


@pytest.mark.parametrize("name", [name for name in BITS if WRITERS[name].extensions != (".bin",)])
def test_the_width_is_kept_without_padding(tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    array = random_frames(3, 5, 13)
    write_capture(jl.Bits.from_array(array), path_for(tmp_path, name), name)
    np.testing.assert_array_equal(jl.open(path_for(tmp_path, name)).to_array(), array)


@pytest.mark.parametrize("name", [name for name in BITS if WRITERS[name].keeps_sensor])
def test_the_sensor_and_the_provenance_are_kept(tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    np.save(tmp_path / "cube.npy", formats.packed(random_frames(3, 5, 16)))
    bits = jl.open(tmp_path / "cube.npy", frames=slice(1, 3))
    bits.sensor = jl.Sensor(frames=2, gain=4.0)
    write_capture(bits, path_for(tmp_path, name), name)
    reopened = jl.open(path_for(tmp_path, name))
    assert (reopened.sensor, reopened.provenance.origin) == (bits.sensor, bits.provenance)
    assert (reopened.provenance.format, reopened.provenance.name) == (
        name,
        path_for(tmp_path, name).name,
    )


@pytest.mark.parametrize(("first", "second"), pairs(COUNTS))
@pytest.mark.parametrize("high", [200, 60000])
def test_counts_survive_conversions(tmp_path, first, second, high):
    for name in (first, second):
        pytest.importorskip(NEEDS.get(name, "numpy"))
    image = np.random.default_rng(0).integers(0, high, (6, 9), np.int32)
    write_capture(image, path_for(tmp_path, first, "a"), first)
    write_capture(jl.open(path_for(tmp_path, first, "a")), path_for(tmp_path, second, "b"), second)
    np.testing.assert_array_equal(jl.open(path_for(tmp_path, second, "b")), image)


@pytest.mark.parametrize("name", ["swissspad2", "swissspad2-full", "spad512s", "spad512s-sparse"])
def test_folders_have_the_camera_layout(tmp_path, monkeypatch, name):
    from jotlight.formats import spad512s

    monkeypatch.setattr(spad512s, "FRAMES_PER_FILE", 10)
    height = 256 if name == "swissspad2" else 512
    frames = {"swissspad2": 512, "swissspad2-full": 256}.get(name, 10) + 2
    array = np.zeros((frames, height, 512), bool)
    array[np.arange(frames), np.arange(frames) % height, 7] = True
    write_capture(jl.Bits.from_array(array), tmp_path / "out", name)
    found = [file for file in files(tmp_path / "out") if file.endswith(".bin")]
    if name.startswith("swissspad2"):
        assert found == ["0/0/filename0.bin", "0/0/filename1.bin"]
        assert (tmp_path / "out" / found[0]).stat().st_size == 1 << 23
    else:
        assert found == ["RAW00000.bin", "RAW00001.bin"]
    bits = jl.open(tmp_path / "out", format=name)
    np.testing.assert_array_equal(bits.counts(), array.sum(0))
    np.testing.assert_array_equal(bits[-3:].to_array(), array[-3:])


@pytest.mark.parametrize("name", BITS)
def test_an_interrupted_conversion_leaves_no_files(tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    from jotlight.sensing.bits.frames import Frames

    def read(start, stop):
        if start > 0:
            raise KeyboardInterrupt
        return np.zeros((stop - start, height, 64), np.uint8)

    height = 256 if name == "swissspad2" else 512
    with pytest.raises(KeyboardInterrupt):
        write_capture(jl.Bits(Frames((2000, height, 64), read)), path_for(tmp_path, name), name)
    assert files(tmp_path) == []


def test_the_name_of_a_file_determines_its_format(tmp_path):
    chosen = {
        choose_output_format(path_for(tmp_path, name))
        for name, writer in WRITERS.items()
        if writer.extensions not in ((), (".bin",))
    }
    assert chosen == {name for name in WRITERS if WRITERS[name].extensions not in ((), (".bin",))}


@pytest.mark.parametrize("name", [name for name in BITS if WRITERS[name].keeps_sensor])
@pytest.mark.parametrize("maps", [("mask",), ("dark_counts", "efficiency", "mask")])
def test_the_maps_of_a_sensor_are_kept(tmp_path, name, maps):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    values = {
        "dark_counts": np.linspace(0, 0.1, 65).reshape(5, 13),
        "efficiency": np.linspace(0.5, 1, 65).reshape(5, 13),
        "mask": np.eye(5, 13, dtype=bool),
    }
    sensor = jl.Sensor(frames=3, **{each: values[each] for each in maps})
    bits = jl.Bits.from_array(random_frames(3, 5, 13), sensor)
    write_capture(bits, path_for(tmp_path, name), name)
    reopened = jl.open(path_for(tmp_path, name))
    assert reopened.sensor == sensor
    np.testing.assert_array_equal(reopened.to_array(), bits.to_array())
    if name in ("hdf5", "zarr"):
        assert jl.open(path_for(tmp_path, name), key="bits").sensor == sensor
        mask = jl.open(path_for(tmp_path, name), key="mask")
        np.testing.assert_array_equal(mask, values["mask"])


def test_invalid_labels_of_counts_are_refused(tmp_path):
    counts = np.full((3, 4), 7, np.int32)
    write_capture(counts, tmp_path / "a.tif", "tiff", trials=6)
    with pytest.raises(ValueError, match=r"expected counts from 0 to 6, .* got 7 to 7"):
        jl.open(tmp_path / "a.tif")
    for wrong in (0, -1, 2**31, "6", 1.5):
        write_capture(counts, tmp_path / "a.tif", "tiff", trials=wrong)
        with pytest.raises(ValueError, match="label: expected"):
            jl.open(tmp_path / "a.tif")


def test_a_format_that_cannot_hold_the_sensor_warns(tmp_path):
    name = "visionsim"
    sensor = jl.Sensor(frames=3, mask=np.eye(5, 13, dtype=bool))
    bits = jl.Bits.from_array(random_frames(3, 5, 13), sensor)
    with pytest.warns(jl.JotlightWarning, match="no place for the sensor"):
        write_capture(bits, path_for(tmp_path, name), name)
    assert jl.open(path_for(tmp_path, name)).sensor is None


@pytest.mark.parametrize("name", [name for name in COUNTS if name not in BITS])
def test_writing_counts_warns_when_sensor_parameters_are_lost(tmp_path, name):
    for parameters in ({"mask": np.eye(5, 13, dtype=bool)}, {"gain": 4.0}, {"threshold": 2}):
        bits = jl.Bits.from_array(random_frames(3, 5, 13), jl.Sensor(frames=3, **parameters))
        with pytest.warns(jl.JotlightWarning, match="no place for the sensor, which is left out"):
            write_capture(bits, path_for(tmp_path, name), name)
    plain = jl.Bits.from_array(random_frames(3, 5, 13), jl.Sensor(frames=3))
    write_capture(plain, path_for(tmp_path, name), name)


@pytest.mark.parametrize("name", ["visionsim", "matlab", "png"])
def test_writing_bits_warns_when_the_orientation_is_lost(tmp_path, name):
    np.save(tmp_path / "cube.npy", formats.packed(random_frames(3, 8, 16)))
    bits = jl.open(tmp_path / "cube.npy", rotate=90)
    with pytest.warns(jl.JotlightWarning, match="no place to record .* rotated by 90 degrees, so"):
        write_capture(bits, path_for(tmp_path, name), name)
    reopened = jl.open(tmp_path / "cube.npy", rotate=360)
    write_capture(reopened, path_for(tmp_path, name, "again"), name)
