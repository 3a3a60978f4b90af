"""Copies of captures, which open their files again, also in other processes."""

import copy
import multiprocessing
import pickle

import numpy as np
import pytest

import jotlight as jl
from examples import READERS
from jotlight.formats import FORMATS
from jotlight.formats.capture import CountStack
from jotlight.formats.reading import open_capture


def content(capture):
    data = capture.images if isinstance(capture, CountStack) else capture.packed
    return np.asarray(data)


@pytest.mark.parametrize("name", FORMATS)
def test_a_copy_of_any_capture_has_the_same_content(name, tmp_path):
    path, _, _ = READERS[name].example(tmp_path)
    options = getattr(READERS[name].read, "keywords", {})
    capture = open_capture(path, **{"format": name, **options})
    for same in (copy.deepcopy(capture), pickle.loads(pickle.dumps(capture))):
        np.testing.assert_array_equal(content(same), content(capture))
        assert same.provenance == capture.provenance


@pytest.fixture
def bits(tmp_path):
    frames = np.random.default_rng(0).random((400, 40, 61)) < 0.5
    jl.save(jl.Bits.from_array(frames, jl.Sensor(frames=400)), tmp_path / "a.npy")
    return jl.open(tmp_path / "a.npy")


def test_a_copy_of_a_part_is_small_and_reads_the_same_frames(bits, monkeypatch, tmp_path):
    turned = jl.open(tmp_path / "a.npy", rotate=90, frames=slice(3, 60))
    parts = [bits, bits[10:90], bits[10:90][5:20:3], turned, turned[1:]]
    texts = [pickle.dumps(part) for part in parts]
    # A process may have another current folder.
    monkeypatch.chdir(tmp_path)
    for part, text in zip(parts, texts, strict=True):
        assert len(text) < 3000
        same = pickle.loads(text)
        np.testing.assert_array_equal(same.to_array(), part.to_array())
        assert same.sensor == part.sensor


def test_a_relative_path_is_that_of_the_time_of_opening(bits, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    text = pickle.dumps(jl.open("a.npy"))
    monkeypatch.chdir("/")
    np.testing.assert_array_equal(pickle.loads(text)[7], bits[7])


def test_a_new_process_opens_the_files_itself(bits):
    assert len(pickle.dumps(bits[100:200])) < 3000
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        [counts] = pool.map(jl.Bits.counts, [bits[100:200]])
    np.testing.assert_array_equal(counts, bits[100:200].counts())


def test_a_channel_of_color_bits_is_copied(tmp_path):
    frames = np.random.default_rng(0).random((9, 8, 16, 3)) < 0.5
    jl.save(jl.Bits.from_array(frames), tmp_path / "a.npy")
    channel = jl.open(tmp_path / "a.npy").channels()[1]
    same = pickle.loads(pickle.dumps(channel))
    np.testing.assert_array_equal(same.to_array(), frames[..., 1])


def test_files_that_are_gone_or_changed_are_refused(bits, tmp_path):
    text, bits_before = pickle.dumps(bits), bits.to_array()
    jl.save(jl.Bits.from_array(np.zeros((3, 40, 61), bool)), tmp_path / "a.npy")
    with pytest.raises(ValueError, match="a file has changed since it was opened"):
        pickle.loads(text)
    same_shape = jl.Bits.from_array(~bits_before, jl.Sensor(frames=400))
    jl.save(same_shape, tmp_path / "a.npy")
    with pytest.raises(ValueError, match="a file has changed since it was opened"):
        pickle.loads(text)
    (tmp_path / "a.npy").unlink()
    with pytest.raises(FileNotFoundError):
        pickle.loads(text)


def test_bits_in_memory_are_copied_with_their_content():
    bits = jl.Bits.from_array(np.eye(9, dtype=bool))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(bits)).to_array(), bits.to_array())
