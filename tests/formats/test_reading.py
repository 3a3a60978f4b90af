"""Options of `jotlight.open`: frames, orientation, and wrong ones."""

import pickle
import re

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from jotlight.errors import SeveralArraysError
from jotlight.formats.frames.labels import AS_STATED
from jotlight.formats.reading import open_capture
from reference import formats as twin

HALF = (256, 512)


def test_frames_are_selected_rotated_and_mirrored(tmp_path):
    array = random_frames((6, *HALF))
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(array))
    bits = jl.open(
        tmp_path / "a.bin",
        format="swissspad2",
        frames=slice(2, 5),
        rotate=90,
        flip="vertical",
    )
    np.testing.assert_array_equal(bits.to_array(), twin.oriented(array[2:5], 90, "vertical"))
    for words in ("frames 2:5 of 6", "rotated by 90 degrees", "mirrored, vertical"):
        assert words in str(bits.provenance.notes)


def test_rotating_a_capture_rotates_the_maps_of_its_sensor(tmp_path):
    mask = random_frames((1, 4, 10))[0]
    jl.save(
        jl.Bits.from_array(random_frames((2, 4, 10)), jl.Sensor(frames=2, mask=mask)),
        tmp_path / "a.npy",
    )
    bits = jl.open(tmp_path / "a.npy", rotate=90)
    np.testing.assert_array_equal(bits.sensor.mask, np.rot90(mask))
    counts = jl.open(tmp_path / "a.npy").counts(mask=mask)
    np.testing.assert_array_equal(bits.counts(mask=bits.sensor.mask), np.rot90(counts))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rotate": 45}, "multiple of 90"),
        ({"flip": "left"}, "horizontal or vertical"),
        ({"frames": slice(9, 12)}, "no frames"),
        ({"key": "x"}, "key: names an array"),
        ({"counts": True}, "holds bits"),
        ({"width": 500}, "width: expected 512"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, message):
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(random_frames((4, *HALF))))
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "a.bin", format="swissspad2", **options)


@pytest.mark.parametrize("frames", [3, 0, (0, 3), [0]])
@pytest.mark.parametrize("kind", ["counts", "bits", "readings"])
def test_frames_that_are_not_a_slice_are_refused(tmp_path, kind, frames):
    if kind == "counts":
        np.save(tmp_path / "a.npy", np.ones((4, 5, 6), int))
    else:
        sensor = jl.Sensor(frames=4, bit_depth=1 if kind == "bits" else 4)
        jl.save(sensor.expose(np.ones((5, 6)), rng=0), tmp_path / "a.npy")
    with pytest.raises(TypeError, match=r"frames: expected a slice, such as slice\(0, 16\), got"):
        jl.open(tmp_path / "a.npy", frames=frames)


@pytest.mark.parametrize("name", ["a.npy", "a.tif", "a.bin", "a.npy.gz", "a"])
def test_an_empty_file_is_called_empty(tmp_path, name):
    (tmp_path / name).touch()
    for options in ({}, {"format": "npy"}, {"format": "tiff"}, {"format": "swissspad2"}):
        with pytest.raises(ValueError, match=f"{name}: expected a capture, got an empty file$"):
            jl.open(tmp_path / name, **options)


@pytest.mark.parametrize("extension", [".npz", ".mat", ".h5"])
def test_the_error_of_a_missing_key_has_the_names_of_the_arrays(tmp_path, extension):
    path, arrays = tmp_path / f"a{extension}", {"dark": np.eye(3), "flat": np.eye(4)}
    if extension == ".npz":
        np.savez(path, **arrays)
    elif extension == ".mat":
        pytest.importorskip("scipy.io").savemat(path, arrays)
    else:
        with pytest.importorskip("h5py").File(path, "w") as file:
            file.update(arrays)
    with pytest.raises(SeveralArraysError) as raised:
        jl.open(path)
    assert raised.value.names == ("dark", "flat")
    kind = "variables" if extension == ".mat" else "arrays"
    expected = f"{path}: expected key= (--key) to name one of its {kind}: dark, flat"
    assert str(raised.value) == expected
    with pytest.raises(SeveralArraysError, match=r"dark, flat; got 'bright'$"):
        jl.open(path, key="bright")
    assert pickle.loads(pickle.dumps(raised.value)).names == ("dark", "flat")


def test_a_bit_depth_that_contradicts_the_file_is_refused(tmp_path):
    readings = jl.Sensor(frames=4, bit_depth=4).expose(np.ones((5, 6)), rng=0)
    jl.save(readings, tmp_path / "a.npy")
    with pytest.raises(ValueError, match=r"bit_depth: a\.npy states readings of 4 bits, not 3;"):
        jl.open(tmp_path / "a.npy", bit_depth=3)
    np.save(tmp_path / "b.npy", readings.to_array())
    message = (
        r"bit_depth: is for images of readings, but bits are requested; leave out unpacked=True"
    )
    for option in ({"counts": False}, {"unpacked": True}):
        with pytest.raises(ValueError, match=message):
            jl.open(tmp_path / "b.npy", bit_depth=4, **option)
    same = jl.open(tmp_path / "a.npy", bit_depth=4)
    np.testing.assert_array_equal(same.to_array(), readings.to_array())


@pytest.mark.parametrize("name", ["a.npy", "a.npy.gz", "a.h5", "a.zarr"])
@pytest.mark.parametrize("option", [{"bit_depth": 4}, {"counts": True}, {"unpacked": True}])
def test_bits_that_a_file_states_are_not_read_as_other_numbers(tmp_path, name, option):
    bits = jl.Sensor(frames=4).expose(np.ones((5, 16)), rng=0)
    jl.save(bits, tmp_path / name)
    with pytest.raises(ValueError, match=re.escape(AS_STATED)):
        jl.open(tmp_path / name, **option)
    np.testing.assert_array_equal(jl.open(tmp_path / name).to_array(), bits.to_array())


@pytest.mark.filterwarnings("ignore:.*only the sum of the 4 frames is saved")
@pytest.mark.parametrize("name", ["a.npz", "a.tif"])
def test_counts_that_a_file_states_are_not_read_as_readings(tmp_path, name):
    bits = jl.Sensor(frames=4).expose(np.ones((5, 16)), rng=0)
    jl.save(bits, tmp_path / name)
    message = rf"bit_depth: {name} states counts out of 4, not readings of 3 bits; leave out"
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / name, bit_depth=3)
    np.testing.assert_array_equal(jl.open(tmp_path / name), bits.counts())


def test_a_slice_of_a_stack_of_counts_has_images(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((6, 4, 5), int))
    stack = open_capture(tmp_path / "a.npy")
    assert len(stack[1:4]) == 3
    with pytest.raises(ValueError, match="counts: no frames in 4:2 of 6"):
        stack[4:2]
    with pytest.raises(TypeError, match=r"counts: .*, got Ellipsis; np\.asarray\(counts\)"):
        stack[..., 3]
    np.testing.assert_array_equal(np.asarray(stack)[..., 3], np.ones((6, 4)))


def test_a_region_of_a_stack_of_counts_keeps_its_trials(tmp_path):
    counts = np.random.default_rng(0).integers(0, 5, (6, 8, 9)).astype(np.uint16)
    np.save(tmp_path / "a.npy", counts)
    stack = open_capture(tmp_path / "a.npy").with_trials_of(jl.Sensor(frames=24))
    part = stack[1:5, 2:6, 3:]
    np.testing.assert_array_equal(np.asarray(part.images), counts[1:5, 2:6, 3:])
    assert (len(part), part.trials) == (4, 4)
    assert part.provenance.notes[-1] == "rows 2:6 and columns 3:9 of 8 x 9"
    np.testing.assert_array_equal(stack[-1, 2:6], counts[-1, 2:6])
    with pytest.raises(TypeError, match=r"counts: expected slices of rows .* got 2"):
        stack[:, 2]
