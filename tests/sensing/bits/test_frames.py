"""Frames in files, and bits made of them."""

import threading

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.bits.frames import (
    Frames,
    concatenate,
    frames_within,
    map_in_thread,
    read_in_chunks,
)
from jotlight.sensing.parameters.provenance import Provenance


def lazy(array, requests=None):
    def read(start, stop):
        if requests is not None:
            requests.append((start, stop))
        return array[start:stop]

    return Frames(array.shape, read, array.dtype)


def random(shape, seed=0):
    return np.random.default_rng(seed).random(shape) < 0.4


CUBE = np.random.default_rng(0).integers(0, 256, (20, 6, 3), np.uint8)
COLOR = np.random.default_rng(0).integers(0, 256, (7, 6, 3, 3), np.uint8)


@pytest.mark.parametrize(
    "key", [slice(2, 9), slice(None), slice(-3, None), slice(1, 18, 4), slice(None, None, -3)]
)
def test_a_range_of_frames_is_read_only_when_it_is_needed(key):
    requests = []
    part = lazy(CUBE, requests)[key]
    assert (part.shape, requests) == (CUBE[key].shape, [])
    np.testing.assert_array_equal(np.asarray(part), CUBE[key])
    np.testing.assert_array_equal(part[1:3, 2:4, :1], CUBE[key][1:3, 2:4, :1])


def test_a_channel_is_read_only_when_it_is_needed():
    requests = []
    part = lazy(COLOR, requests)[..., 1]
    assert (part.shape, requests) == ((7, 6, 3), [])
    np.testing.assert_array_equal(part[2:5, ...], COLOR[2:5, ..., 1])


@pytest.mark.parametrize("key", [3, (3,), None, (), [1, 2]])
def test_other_keys_are_refused(key):
    with pytest.raises((TypeError, ValueError), match="expected"):
        lazy(CUBE)[key]


def test_a_file_that_has_changed_is_found():
    frames = Frames((5, 2, 2), lambda start, stop: np.zeros((1, 2, 2), np.uint8))
    with pytest.raises(ValueError, match="has changed since it was opened"):
        frames[:, ...]


def test_chunks_have_a_bounded_size():
    requests = []
    parts = list(read_in_chunks(lazy(CUBE, requests), 18 * 7))
    assert requests == [(0, 7), (7, 14), (14, 20)]
    np.testing.assert_array_equal(np.concatenate([part for _, part in parts]), CUBE)


def test_the_first_frames_have_a_bounded_size_but_one_frame_is_always_read():
    requests = []
    frames = lazy(CUBE, requests)
    numbers = [frames_within(frames, size) for size in (0, 17, 18, 35, 36, 18 * 20, 18 * 50)]
    assert numbers == [1, 1, 1, 1, 2, 20, 50]
    assert frames_within(lazy(CUBE[:0]), 18) == 18
    assert requests == []


def test_a_function_runs_while_the_next_item_is_made():
    running, made = threading.Event(), threading.Event()

    def items():
        yield "first"
        assert running.wait(20)
        made.set()
        yield "second"

    def function(item):
        running.set()
        assert made.wait(20)
        return item.upper()

    assert list(map_in_thread(function, items())) == ["FIRST", "SECOND"]


@pytest.mark.parametrize("number", [0, 2])
def test_the_error_of_a_function_in_a_thread_is_raised(number):
    with pytest.raises(ZeroDivisionError):
        list(map_in_thread(lambda item: 1 / (item - number), range(3)))


@pytest.mark.parametrize("cuts", [[], [5], [0, 5, 5, 19, 20]])
def test_concatenated_frames_equal_one_array(cuts):
    one = concatenate([lazy(part) for part in np.split(CUBE, cuts)])
    for start in range(20):
        for stop in range(start + 1, 21):
            np.testing.assert_array_equal(one[start:stop, ...], CUBE[start:stop])


@pytest.mark.parametrize("shape", [(9, 12, 13), (9, 12, 16, 3)])
def test_bits_in_files_behave_like_bits_in_memory(shape, tmp_path):
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
def test_every_kind_of_method_accepts_bits_in_files(method):
    from jotlight.evaluation.methods import METHODS

    sensor = jl.Sensor(oversampling=2, frames=3, kernel="box")
    kept = sensor.expose(np.full((8, 9), 0.4), rng=0)
    bits = jl.Bits(lazy(kept.packed), kept.width, sensor)
    run = METHODS[method].run
    np.testing.assert_array_equal(run(bits, sensor), run(kept, sensor))


def test_a_network_with_weights_of_jots_accepts_bits_in_files():
    sensor = jl.Sensor(oversampling=2, frames=3)
    kept = sensor.expose(np.full((8, 9), 0.4), rng=0)
    network = jl.Network.initial(sensor, tied=False)
    bits = jl.Bits(lazy(kept.packed), kept.width, sensor)
    np.testing.assert_array_equal(network.reconstruct(bits), network.reconstruct(kept))


def test_the_provenance_of_a_slice_names_its_frames():
    provenance = Provenance("npy", "cube.npy")
    bits = jl.Bits(CUBE, provenance=provenance)
    assert bits[4:10].provenance.notes == ("frames 4:10 of 20",)
    assert bits[:].provenance == provenance
