"""Raw frames of every camera: bytes without a header."""

import gzip
import warnings

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from reference import formats as twin

HALF, FULL = (256, 512), (512, 512)
RAW = {
    "swissspad2": (HALF, twin.encode_half_array),
    "swissspad2-full": (FULL, twin.encode_full_array),
    "spad512s": (FULL, twin.encode_spad512s),
    "spad512s-sparse": (FULL, twin.encode_spad512s_sparse),
}
"""Shape of a frame, and the twin that encodes frames, by the name of the format."""


@pytest.mark.parametrize("name", RAW)
def test_a_file_is_decoded_as_its_twin_encodes_it(name, tmp_path):
    size, encode = RAW[name]
    array = random_frames((3, *size))
    (tmp_path / "a.bin").write_bytes(encode(array))
    bits = jl.open(tmp_path / "a.bin", format=name)
    assert bits.shape == array.shape
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits.counts(), array.sum(0))
    np.testing.assert_array_equal(bits[1:2].to_array(), array[1:2])
    assert bits.provenance.format == name
    assert bits.provenance.notes


@pytest.mark.parametrize("name", RAW)
def test_an_incomplete_last_frame_is_left_out_with_a_warning(name, tmp_path):
    size, encode = RAW[name]
    array = random_frames((2, *size))
    (tmp_path / "a.bin").write_bytes(encode(array)[:-6])
    with pytest.warns(jl.JotlightWarning, match=r"1 complete frame.* left over"):
        bits = jl.open(tmp_path / "a.bin", format=name)
    np.testing.assert_array_equal(bits.to_array(), array[:1])


@pytest.mark.parametrize("name", RAW)
@pytest.mark.parametrize("content", [b"", b"x", b"DONE"])
def test_a_file_without_a_complete_frame_is_refused_without_a_warning(name, content, tmp_path):
    (tmp_path / "a.bin").write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error", jl.JotlightWarning)
        with pytest.raises(ValueError, match=r"a\.bin.*expected"):
            jl.open(tmp_path / "a.bin", format=name)


def test_the_format_of_raw_frames_is_required(tmp_path):
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(random_frames((2, *HALF))))
    for path in (tmp_path / "a.bin", tmp_path):
        with pytest.raises(ValueError, match=r"pass format= \(--format\).*swissspad2"):
            jl.open(path)
    with pytest.raises(ValueError, match="format: expected one of npy"):
        jl.open(tmp_path / "a.bin", format="swisspad")


@pytest.mark.parametrize("name", RAW)
def test_compressed_frames_are_read_in_any_order(name, tmp_path):
    size, encode = RAW[name]
    array = random_frames((3, *size))
    for number, part in enumerate((array[:2], array[2:])):
        (tmp_path / f"RAW{number}.bin.gz").write_bytes(gzip.compress(encode(part), mtime=0))
    bits = jl.open(tmp_path, format=name)
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits[1:].counts(), array[1:].sum(0))
    one = tmp_path / "RAW0.bin.gz"
    np.testing.assert_array_equal(jl.open(one, format=name).to_array(), array[:2])
    with pytest.raises(ValueError, match=r"pass format= \(--format\)"):
        jl.open(one)
    one.write_bytes(one.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"RAW0.*damaged or truncated"):
        jl.open(one, format=name)


@pytest.mark.parametrize("name", RAW)
@pytest.mark.parametrize("beginning", [b"\x93NUMPY", b"\x1f\x8b\x08", b"\x89PNG\r\n\x1a\n"])
def test_files_of_other_types_are_refused(name, beginning, tmp_path):
    (tmp_path / "a.bin").write_bytes(beginning + bytes(40000))
    with pytest.raises(ValueError, match=r"a\.bin: expected raw frames, but its first bytes"):
        jl.open(tmp_path / "a.bin", format=name)


def test_a_file_that_becomes_shorter_while_it_is_open_raises_an_error(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(twin.encode_half_array(random_frames((4, *HALF))))
    bits = jl.open(path, format="swissspad2")
    path.write_bytes(b"")
    with pytest.raises(OSError, match=r"a\.bin: the file has changed since it was opened"):
        bits.counts()
