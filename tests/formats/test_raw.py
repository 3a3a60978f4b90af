"""SwissSPAD2 and SPAD512S."""

import gzip
import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.file_lists import natural_sort_key
from reference import formats as twin

HALF, FULL = (256, 512), (512, 512)


def random(frames, size, seed=0, share=0.3):
    return np.random.default_rng(seed).random((frames, *size)) < share


RAW = {
    "swissspad2": (HALF, twin.encode_half_array),
    "swissspad2-full": (FULL, twin.encode_full_array),
    "spad512s": (FULL, twin.encode_spad512s),
    "spad512s-sparse": (FULL, twin.encode_spad512s_sparse),
}


@pytest.mark.parametrize("name", RAW)
def test_a_file_is_read_as_its_twin_says(name, tmp_path):
    size, encode = RAW[name]
    array = random(3, size)
    (tmp_path / "a.bin").write_bytes(encode(array))
    bits = jl.open(tmp_path / "a.bin", format=name)
    assert bits.shape == array.shape
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits.counts(), array.sum(0))
    np.testing.assert_array_equal(bits[1:2].to_array(), array[1:2])
    assert bits.provenance.format == name
    assert bits.provenance.notes


@pytest.mark.parametrize("name", RAW)
def test_a_partial_last_frame_is_left_over_and_said(name, tmp_path):
    size, encode = RAW[name]
    array = random(2, size)
    (tmp_path / "a.bin").write_bytes(encode(array)[:-6])
    with pytest.warns(jl.JotlightWarning, match=r"1 whole frame.* left over"):
        bits = jl.open(tmp_path / "a.bin", format=name)
    np.testing.assert_array_equal(bits.to_array(), array[:1])


@pytest.mark.parametrize("name", RAW)
@pytest.mark.parametrize("content", [b"", b"x", b"DONE"])
def test_a_file_without_a_whole_frame_is_refused(name, content, tmp_path):
    (tmp_path / "a.bin").write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        with pytest.raises(ValueError, match=r"a\.bin.*expected"):
            jl.open(tmp_path / "a.bin", format=name)


def test_raw_frames_are_asked_for(tmp_path):
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(random(2, HALF)))
    for path in (tmp_path / "a.bin", tmp_path):
        with pytest.raises(ValueError, match=r"give the one it is of.*--format.*swissspad2"):
            jl.open(path)
    with pytest.raises(ValueError, match="format: expected one of npy"):
        jl.open(tmp_path / "a.bin", format="swisspad")


def test_a_folder_is_sorted_by_the_number_in_the_names(tmp_path):
    array = random(12, HALF)
    for number in range(12):
        folder = tmp_path / str(number // 8) / str(number // 3)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"filename{number}.bin").write_bytes(
            twin.encode_half_array(array[number : number + 1])
        )
    (tmp_path / "notes.txt").write_text("no frames")
    bits = jl.open(tmp_path, format="swissspad2")
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits[3:11].counts(), array[3:11].sum(0))
    assert "12 files" in str(bits.provenance.notes)


def test_missing_and_doubled_files_are_said(tmp_path):
    content = twin.encode_half_array(random(1, HALF))
    for number in (0, 1, 4):
        (tmp_path / f"filename{number}.bin").write_bytes(content)
    with pytest.warns(jl.JotlightWarning, match="2 of the files 0 to 4 are missing"):
        jl.open(tmp_path, format="swissspad2")
    (tmp_path / "other4.bin").write_bytes(content)
    with pytest.raises(ValueError, match="one capture at a time"):
        jl.open(tmp_path, format="swissspad2")


def test_a_done_at_the_end_tells_the_format_and_is_no_frame(tmp_path):
    array = random(3, FULL)
    for number, part in enumerate((array[:2], array[2:])):
        (tmp_path / f"RAW{number:05d}.bin").write_bytes(twin.encode_spad512s(part) + b"DONE")
    bits = jl.open(tmp_path)
    assert bits.provenance.format == "spad512s"
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(jl.open(tmp_path / "RAW00001.bin").to_array(), array[2:])


@pytest.mark.parametrize("name", ["spad512s", "spad512s-sparse"])
@pytest.mark.parametrize("cut", [0, 1, 4, 6, 400])
def test_a_done_is_taken_off_whatever_is_left_of_the_last_frame(name, cut, tmp_path):
    array = random(2, FULL)
    whole = RAW[name][1](array)
    (tmp_path / "a.bin").write_bytes(whole[: len(whole) - cut] + b"DONE")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        bits = jl.open(tmp_path / "a.bin")
    assert bits.provenance.format == name
    np.testing.assert_array_equal(bits.to_array(), array[: 1 if cut else 2])
    assert ["1 whole frame" in str(one.message) for one in caught] == [True] * (cut > 0)


@pytest.mark.parametrize("ended", [0, 1])
def test_one_done_in_a_folder_tells_the_format(ended, tmp_path):
    array = random(2, FULL, share=1e-5)
    for number, frame in enumerate(array):
        content = twin.encode_spad512s(frame[None]) + (b"DONE" if number == ended else b"")
        (tmp_path / f"RAW{number}.bin").write_bytes(content)
    bits = jl.open(tmp_path)
    assert bits.provenance.format == "spad512s"
    np.testing.assert_array_equal(bits.to_array(), array)


@pytest.mark.parametrize("name", RAW)
def test_compressed_frames_are_read_as_a_stream(name, tmp_path):
    size, encode = RAW[name]
    array = random(3, size)
    for number, part in enumerate((array[:2], array[2:])):
        (tmp_path / f"RAW{number}.bin.gz").write_bytes(gzip.compress(encode(part), mtime=0))
    bits = jl.open(tmp_path, format=name)
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits[1:].counts(), array[1:].sum(0))
    one = tmp_path / "RAW0.bin.gz"
    np.testing.assert_array_equal(jl.open(one, format=name).to_array(), array[:2])
    with pytest.raises(ValueError, match="give the one it is of"):
        jl.open(one)
    one.write_bytes(one.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"RAW0.*damaged or truncated"):
        jl.open(one, format=name)


@pytest.mark.parametrize("name", RAW)
@pytest.mark.parametrize("beginning", [b"\x93NUMPY", b"\x1f\x8b\x08", b"\x89PNG\r\n\x1a\n"])
def test_what_is_plainly_something_else_is_no_raw_frames(name, beginning, tmp_path):
    (tmp_path / "a.bin").write_bytes(beginning + bytes(40000))
    with pytest.raises(ValueError, match=r"a\.bin: expected raw frames, and its first bytes"):
        jl.open(tmp_path / "a.bin", format=name)


def test_files_of_a_folder_are_in_natural_order(tmp_path):
    array = random(11, FULL)
    for number, frame in enumerate(array):
        (tmp_path / f"RAW{number}.bin").write_bytes(twin.encode_spad512s(frame[None]))
    bits = jl.open(tmp_path, format="spad512s")
    np.testing.assert_array_equal(bits.to_array(), array)


def test_natural_order(tmp_path):
    names = ["a/2.bin", "a/10.bin", "b/1.bin", "b/1x2.bin", "b/1x10.bin"]
    paths = [tmp_path / name for name in names]
    assert sorted(paths, key=natural_sort_key) == paths


def test_a_sparse_file_of_many_frames_is_read_from_anywhere(tmp_path):
    array = random(130, FULL, share=2e-5)
    array[5] = False
    (tmp_path / "a.bin").write_bytes(twin.encode_spad512s_sparse(array))
    bits = jl.open(tmp_path / "a.bin", format="spad512s-sparse")
    assert len(bits) == 130
    for part in (slice(0, 1), slice(62, 66), slice(120, 129), slice(129, 130)):
        np.testing.assert_array_equal(bits[part].to_array(), array[part])
    np.testing.assert_array_equal(bits.counts(), array.sum(0))


def test_what_is_no_sparse_file_is_refused_with_its_place(tmp_path):
    words = np.array([5, 262144, 300000, 262144], "<u4")
    (tmp_path / "a.bin").write_bytes(words.tobytes())
    with pytest.raises(ValueError, match=r"got 300000 at byte 8"):
        jl.open(tmp_path / "a.bin", format="spad512s-sparse")


def test_a_file_that_becomes_shorter_while_it_is_open_is_no_crash(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(twin.encode_half_array(random(4, HALF)))
    bits = jl.open(path, format="swissspad2")
    path.write_bytes(b"")
    with pytest.raises(OSError, match="has become shorter"):
        bits.counts()


def test_frames_are_chosen_turned_and_mirrored(tmp_path):
    array = random(6, HALF)
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(array))
    bits = jl.open(
        tmp_path / "a.bin",
        format="swissspad2",
        frames=slice(2, 5),
        rotate=90,
        flip="vertical",
    )
    np.testing.assert_array_equal(bits.to_array(), twin.turned(array[2:5], 90, "vertical"))
    for words in ("frames 2:5 of 6", "rotated by 90 degrees", "mirrored, vertical"):
        assert words in str(bits.provenance.notes)


def test_the_turn_of_a_sensor_turns_its_maps(tmp_path):
    mask = random(1, (4, 10))[0]
    jl.save(
        jl.Bits.from_array(random(2, (4, 10)), jl.Sensor(frames=2, mask=mask)), tmp_path / "a.npy"
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
        ({"frames": slice(3, 0, -1)}, "forward|no frames"),
        ({"key": "x"}, "key: names an array"),
        ({"counts": True}, "holds bits"),
        ({"width": 500}, "width: expected 512"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, message):
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(random(4, HALF)))
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "a.bin", format="swissspad2", **options)
