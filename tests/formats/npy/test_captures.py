"""Reading `.npy` and `.npz` captures: photon cubes, booleans, and counts."""

import json

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_bits, random_frames
from folders import file_names
from jotlight.formats.reading import open_capture
from jotlight.formats.writing import write_capture
from jotlight.sensing.parameters.provenance import Provenance

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("shape", [(3, 5, 16), (2, 6, 24, 3)])
def test_photon_cubes_of_other_programs_are_read(tmp_path, shape, order):
    values = np.random.default_rng(1).random(shape) < 0.5
    np.save(tmp_path / "cube.npy", np.asarray(np.packbits(values, axis=2), order=order))
    bits = jl.open(tmp_path / "cube.npy")
    assert (bits.shape, bits.sensor) == (shape, None)
    np.testing.assert_array_equal(bits.to_array(), values)
    np.testing.assert_array_equal(bits.counts(1), values.sum(0))


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_every_version_of_npy_is_read(tmp_path, version):
    packed = np.arange(12, dtype=np.uint8).reshape(2, 3, 2)
    with (tmp_path / "cube.npy").open("wb") as file:
        np.lib.format.write_array(file, packed, version=version)
    np.testing.assert_array_equal(jl.open(tmp_path / "cube.npy").packed, packed)


def test_the_caller_can_state_the_width_of_a_cube_without_a_description(tmp_path):
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 2), np.uint8))
    assert jl.open(tmp_path / "cube.npy", width=11).shape == (2, 3, 11)
    with pytest.raises(ValueError, match=r"cube\.npy: width: expected 9 to 16"):
        jl.open(tmp_path / "cube.npy", width=17)


def test_booleans_are_bits_and_other_numbers_are_counts(tmp_path):
    array = random_frames((3, 5, 11))
    np.save(tmp_path / "a.npy", array)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npy").to_array(), array)
    np.savez(tmp_path / "a.npz", array)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npz").to_array(), array)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npz", counts=True, frames=slice(0, 3)),
                                  array.sum(0))  # fmt: skip
    np.save(tmp_path / "a.npy", COUNTS[0])
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npy"), COUNTS[0])
    np.save(tmp_path / "a.npy", COUNTS.astype(np.uint8))
    counts = jl.open(tmp_path / "a.npy", counts=True, frames=slice(0, 2))
    np.testing.assert_array_equal(counts, COUNTS.astype(np.uint8)[:2].sum(0, dtype=int))
    assert jl.open(tmp_path / "a.npy").shape == (5, 6, 56)


def test_a_stack_of_counts_is_summed_with_a_warning(tmp_path):
    np.savez(tmp_path / "a.npz", a=COUNTS, b=COUNTS[0])
    with pytest.warns(jl.JotlightWarning, match="the sum of its 5 images"):
        counts = jl.open(tmp_path / "a.npz", key="a")
    assert counts.dtype == np.int32
    np.testing.assert_array_equal(counts, COUNTS.sum(0))
    part = jl.open(tmp_path / "a.npz", key="a", frames=slice(1, 3), rotate=90)
    np.testing.assert_array_equal(part, np.rot90(COUNTS[1:3].sum(0)))
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npz", key="b"), COUNTS[0])
    with pytest.raises(ValueError, match=r"--key.*a, b"):
        jl.open(tmp_path / "a.npz")


@pytest.mark.parametrize("shape", [(0, 4, 4), (4, 0, 4), (4, 4, 0), (0, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, bool])
def test_arrays_without_numbers_are_refused(tmp_path, shape, dtype):
    np.save(tmp_path / "a.npy", np.zeros(shape, dtype))
    with pytest.raises(ValueError, match=r"a\.npy: .* with a dimension of 0"):
        jl.open(tmp_path / "a.npy")


def test_impossible_counts_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[-1, 2]]))
    with pytest.raises(ValueError, match="counts from 0"):
        jl.open(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.array([[[2**31 - 1] * 5]] * 2))
    with pytest.raises(ValueError, match="the sum of its counts"):
        jl.open(tmp_path / "a.npy", frames=slice(None))
    np.save(tmp_path / "a.npy", np.array([[0, 255], [510, 0]]))
    with pytest.warns(jl.JotlightWarning, match="multiples of 255"):
        jl.open(tmp_path / "a.npy")


@pytest.mark.parametrize("name", ["a.npy", "a.npy.gz"])
def test_counts_keep_their_trials_and_provenance_in_a_description(tmp_path, name):
    counts, provenance = COUNTS[0].astype(np.int32), Provenance("tiff", "first.tif")
    write_capture(counts, tmp_path / name, name[2:], trials=400, provenance=provenance)
    capture = open_capture(tmp_path / name)
    assert (capture.trials, capture.provenance.origin) == (400, provenance)
    np.testing.assert_array_equal(capture.images[0], counts)
    assert len(file_names(tmp_path)) == 2


@pytest.mark.parametrize("name", ["a.npy", "a.npy.gz"])
def test_changed_counts_are_refused(tmp_path, name):
    jl.save(COUNTS[0].astype(np.int32), tmp_path / name)
    content = bytearray((tmp_path / name).read_bytes())
    content[-9 if name.endswith("gz") else -1] ^= 1
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=rf"{name}: is damaged or was changed"):
        jl.open(tmp_path / name)


def test_counts_replace_bits_and_their_maps(tmp_path):
    jl.save(random_bits((1, 3, 9), jl.Sensor(mask=np.eye(3, 9) > 0)), tmp_path / "a.npy")
    jl.save(COUNTS[0].astype(np.int32), tmp_path / "a.npy")
    assert file_names(tmp_path) == ["a.json", "a.npy"]
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npy"), COUNTS[0])


def test_a_description_of_something_else_is_refused(tmp_path):
    jl.save(random_bits((2, 3, 9)), tmp_path / "a.npy")
    with pytest.raises(ValueError, match=r"description of jotlight bits, but a\.npy is read as"):
        jl.open(tmp_path / "a.npy", counts=True)
    bits = (tmp_path / "a.npy").read_bytes()
    jl.save(COUNTS[0].astype(np.int32), tmp_path / "a.npy")
    (tmp_path / "a.npy").write_bytes(bits)
    description = json.loads((tmp_path / "a.json").read_text())
    del description["checksum"], description["sha256"]
    (tmp_path / "a.json").write_text(json.dumps({**description, "shape": [2, 3, 2]}))
    with pytest.raises(ValueError, match=r"description of jotlight counts, but a\.npy is read as"):
        jl.open(tmp_path / "a.npy", counts=False)
