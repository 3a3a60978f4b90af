import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.orientation import orient_packed, transpose_packed
from jotlight.sensing.frames import Frames, concatenate, read_in_chunks
from jotlight.sensing.provenance import Provenance
from reference import formats as twin


def lazy(array, asked=None):
    def read(start, stop):
        if asked is not None:
            asked.append((start, stop))
        return array[start:stop]

    return Frames(array.shape, read, array.dtype)


def random(shape, seed=0):
    return np.random.default_rng(seed).random(shape) < 0.4


CUBE = np.random.default_rng(0).integers(0, 256, (20, 6, 3), np.uint8)
COLOUR = np.random.default_rng(0).integers(0, 256, (7, 6, 3, 3), np.uint8)


@pytest.mark.parametrize("key", [slice(2, 9), slice(None), slice(-3, None), slice(1, 18, 4)])
def test_a_range_is_not_read_until_it_is_asked_for(key):
    asked = []
    part = lazy(CUBE, asked)[key]
    assert (part.shape, asked) == (CUBE[key].shape, [])
    np.testing.assert_array_equal(np.asarray(part), CUBE[key])
    np.testing.assert_array_equal(part[1:3, 2:4, :1], CUBE[key][1:3, 2:4, :1])


def test_a_channel_stays_in_its_file():
    asked = []
    part = lazy(COLOUR, asked)[..., 1]
    assert (part.shape, asked) == ((7, 6, 3), [])
    np.testing.assert_array_equal(part[2:5, ...], COLOUR[2:5, ..., 1])


@pytest.mark.parametrize("key", [3, (3,), None, (), [1, 2], slice(9, 2, -1), (slice(5, 1, -1),)])
def test_other_keys_are_refused(key):
    with pytest.raises((TypeError, ValueError), match="expected"):
        lazy(CUBE)[key]


def test_a_reader_that_gives_too_little_is_found_out():
    frames = Frames((5, 2, 2), lambda start, stop: np.zeros((1, 2, 2), np.uint8))
    with pytest.raises(ValueError, match="has changed since it was opened"):
        frames[:, ...]


def test_parts_are_of_bounded_size():
    asked = []
    parts = list(read_in_chunks(lazy(CUBE, asked), 18 * 7))
    assert asked == [(0, 7), (7, 14), (14, 20)]
    np.testing.assert_array_equal(np.concatenate([part for _, part in parts]), CUBE)


@pytest.mark.parametrize("cuts", [[], [5], [0, 5, 5, 19, 20]])
def test_joined_frames_are_as_one_array(cuts):
    one = concatenate([lazy(part) for part in np.split(CUBE, cuts)])
    for start in range(20):
        for stop in range(start + 1, 21):
            np.testing.assert_array_equal(one[start:stop, ...], CUBE[start:stop])


@pytest.mark.parametrize("shape", [(9, 12, 13), (9, 12, 16, 3)])
def test_bits_in_files_do_what_bits_in_memory_do(shape, tmp_path):
    array = random(shape)
    kept = jl.Bits.from_array(array)
    bits = jl.Bits(lazy(kept.packed), shape[2])
    assert bits.shape == kept.shape
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits.counts(1), kept.counts(1))
    mask = random(shape[1:3], 1)
    np.testing.assert_array_equal(bits.counts(1, mask=mask), kept.counts(1, mask=mask))
    np.testing.assert_array_equal(bits[2:7].to_array(), array[2:7])
    jl.save(bits, tmp_path / "bits.npy")
    np.testing.assert_array_equal(jl.open(tmp_path / "bits.npy").to_array(), array)
    sensor = jl.Sensor(frames=9)
    np.testing.assert_array_equal(jl.mle(bits, sensor), jl.mle(kept, sensor))


@pytest.mark.parametrize("method", ["mle-iterative", "admm-tv", "network-initial"])
def test_every_kind_of_method_takes_bits_in_files(method):
    from jotlight.evaluation.methods import METHODS

    sensor = jl.Sensor(oversampling=2, frames=3, kernel="box")
    kept = sensor.expose(np.full((8, 9), 0.4), rng=0)
    bits = jl.Bits(lazy(kept.packed), kept.width, sensor)
    run = METHODS[method].run
    np.testing.assert_array_equal(run(bits, sensor), run(kept, sensor))


def test_a_network_that_weighs_jots_takes_bits_in_files():
    sensor = jl.Sensor(oversampling=2, frames=3)
    kept = sensor.expose(np.full((8, 9), 0.4), rng=0)
    network = jl.Network.initial(sensor, tied=False)
    bits = jl.Bits(lazy(kept.packed), kept.width, sensor)
    np.testing.assert_array_equal(network.reconstruct(bits), network.reconstruct(kept))


def test_a_slice_tells_which_frames_it_has():
    provenance = Provenance("npy", "cube.npy")
    bits = jl.Bits(CUBE, provenance=provenance)
    assert bits[4:10].provenance.notes == ("frames 4:10 of 20",)
    assert bits[:].provenance == provenance


@pytest.mark.parametrize("shape", [(2, 8, 8), (3, 5, 13), (1, 1, 1), (2, 17, 9), (1, 24, 16)])
def test_packed_bits_are_transposed(shape):
    array = random(shape)
    expected = twin.packed(array.swapaxes(1, 2))
    np.testing.assert_array_equal(transpose_packed(twin.packed(array), shape[2]), expected)


@pytest.mark.parametrize("shape", [(2, 5, 13), (3, 8, 16), (2, 3, 11, 3)])
@pytest.mark.parametrize("flip", [None, "horizontal", "vertical"])
@pytest.mark.parametrize("degrees", [0, 90, 180, 270, -90, 450])
def test_packed_frames_are_turned(shape, degrees, flip):
    array = random(shape)
    packed, width = orient_packed(twin.packed(array), shape[2], degrees // 90 % 4, flip)
    expected = twin.oriented(array, degrees, flip)
    assert jl.Bits(packed, width).shape == expected.shape
    np.testing.assert_array_equal(np.asarray(packed), twin.packed(expected))
