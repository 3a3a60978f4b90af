"""SPAD512S: trailers, folders, and sparse files."""

import warnings

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from reference import formats as twin

FULL = (512, 512)
ENCODE = {"spad512s": twin.encode_spad512s, "spad512s-sparse": twin.encode_spad512s_sparse}


def test_a_trailer_identifies_the_format_and_is_no_frame(tmp_path):
    array = random_frames((3, *FULL))
    for number, part in enumerate((array[:2], array[2:])):
        (tmp_path / f"RAW{number:05d}.bin").write_bytes(twin.encode_spad512s(part) + b"DONE")
    bits = jl.open(tmp_path)
    assert bits.provenance.format == "spad512s"
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(jl.open(tmp_path / "RAW00001.bin").to_array(), array[2:])


@pytest.mark.parametrize("name", ENCODE)
@pytest.mark.parametrize("cut", [0, 1, 4, 6, 400])
def test_a_trailer_is_removed_after_an_incomplete_frame(name, cut, tmp_path):
    array = random_frames((2, *FULL))
    whole = ENCODE[name](array)
    (tmp_path / "a.bin").write_bytes(whole[: len(whole) - cut] + b"DONE")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        bits = jl.open(tmp_path / "a.bin")
    assert bits.provenance.format == name
    np.testing.assert_array_equal(bits.to_array(), array[: 1 if cut else 2])
    assert ["1 complete frame" in str(one.message) for one in caught] == [True] * (cut > 0)


@pytest.mark.parametrize("ended", [0, 1])
def test_one_trailer_in_a_folder_identifies_the_format(ended, tmp_path):
    array = random_frames((2, *FULL), share=1e-5)
    for number, frame in enumerate(array):
        content = twin.encode_spad512s(frame[None]) + (b"DONE" if number == ended else b"")
        (tmp_path / f"RAW{number}.bin").write_bytes(content)
    with pytest.warns(jl.JotlightWarning, match=f"RAW{1 - ended}.bin: .* does not end with"):
        bits = jl.open(tmp_path)
    assert bits.provenance.format == "spad512s"
    np.testing.assert_array_equal(bits.to_array(), array)


def test_an_empty_sparse_file_between_others_is_stated(tmp_path):
    array = random_frames((3, *FULL), share=1e-5)
    jl.save(jl.Bits.from_array(array), tmp_path / "a.bin", format="spad512s-sparse")
    content = (tmp_path / "a.bin").read_bytes()
    (tmp_path / "folder").mkdir()
    for number in range(3):
        (tmp_path / f"folder/RAW{number}.bin").write_bytes(content if number != 1 else b"DONE")
    with pytest.warns(jl.JotlightWarning, match="RAW1.bin: expected at least 3 frames, .*, got 0"):
        assert len(jl.open(tmp_path / "folder")) == 6


def test_files_of_a_folder_are_in_natural_order(tmp_path):
    array = random_frames((11, *FULL))
    for number, frame in enumerate(array):
        (tmp_path / f"RAW{number}.bin").write_bytes(twin.encode_spad512s(frame[None]))
    bits = jl.open(tmp_path, format="spad512s")
    np.testing.assert_array_equal(bits.to_array(), array)


def test_a_sparse_file_of_many_frames_is_read_in_any_order(tmp_path):
    rng = np.random.default_rng(0)
    array = np.zeros((130, *FULL), bool)
    array[np.repeat(np.arange(130), 5), *rng.integers(0, 512, (2, 650))] = True
    array[5] = False
    (tmp_path / "a.bin").write_bytes(twin.encode_spad512s_sparse(array))
    bits = jl.open(tmp_path / "a.bin", format="spad512s-sparse")
    assert len(bits) == 130
    for part in (slice(0, 1), slice(62, 66), slice(120, 129), slice(129, 130)):
        np.testing.assert_array_equal(bits[part].to_array(), array[part])
    np.testing.assert_array_equal(bits.counts(), array.sum(0))


def test_an_impossible_position_in_a_sparse_file_is_refused(tmp_path):
    words = np.array([5, 262144, 300000, 262144], "<u4")
    (tmp_path / "a.bin").write_bytes(words.tobytes())
    with pytest.raises(ValueError, match=r"got 300000 at byte 8"):
        jl.open(tmp_path / "a.bin", format="spad512s-sparse")


@pytest.mark.parametrize("name", ENCODE)
@pytest.mark.parametrize("path", ["a.bin", "folder"])
@pytest.mark.parametrize("share", [0.1, 0.0])
def test_what_is_written_is_detected(name, path, share, tmp_path):
    array = random_frames((2, *FULL), share=share)
    jl.save(jl.Bits.from_array(array), tmp_path / path, format=name)
    bits = jl.open(tmp_path / path)
    assert bits.provenance.format == name
    np.testing.assert_array_equal(bits.to_array(), array)


@pytest.mark.parametrize("name", ENCODE)
def test_a_wrong_frame_size_names_the_format(name, tmp_path):
    with pytest.raises(ValueError, match=rf"^{name}: expected frames of 512 x 512 jots, got 4 x 8"):
        jl.save(jl.Bits.from_array(np.zeros((4, 8), bool)), tmp_path / "a.bin", format=name)
