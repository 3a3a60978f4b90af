"""zarr folders that jotlight wrote: every file is protected, and zarr can read them."""

import json
import shutil

import numpy as np
import pytest

import jotlight as jl
from examples.captures import BITS, BITS_WITH_MAPS, COUNTS, open_counts
from jotlight.formats.files.checksums import seal
from jotlight.formats.verification import verify_capture
from jotlight.formats.writing import write_capture
from jotlight.formats.zarr import writing as module

zarr = pytest.importorskip("zarr")
CAPTURES = {"bits": BITS, "maps": BITS_WITH_MAPS, "counts": COUNTS}


@pytest.fixture(params=CAPTURES)
def folder(request, tmp_path):
    write_capture(CAPTURES[request.param], tmp_path / "a", name="zarr")
    return tmp_path / "a"


def files_in(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def assert_refused(folder, match=None):
    for read in (open_counts, verify_capture):
        with pytest.raises(ValueError, match=match):
            read(folder)


def flips_are_refused(folder, step):
    """Flip every `step`-th bit of all files. Return the number of flips."""
    number = 0
    for path in files_in(folder):
        content = path.read_bytes()
        for bit in range(number % step, 8 * len(content), step):
            changed = bytearray(content)
            changed[bit // 8] ^= 1 << bit % 8
            path.write_bytes(changed)
            assert_refused(folder)
            number += 1
        path.write_bytes(content)
    jl.open(folder)
    return number


def test_some_flipped_bits_are_refused(folder):
    assert flips_are_refused(folder, 997) > 8


@pytest.mark.exhaustive
@pytest.mark.parametrize(("data", "step"), [(COUNTS[:1, :1], 3), (BITS_WITH_MAPS, 19)])
def test_more_flipped_bits_are_refused(tmp_path, data, step):
    # Without maps, a folder has about 10,000 bits; with maps, 27,000.
    write_capture(data, tmp_path / "a", name="zarr")
    assert flips_are_refused(tmp_path / "a", step) > 1000


def test_every_missing_or_emptied_file_is_refused(folder):
    for path in files_in(folder):
        content = path.read_bytes()
        path.unlink()
        assert_refused(folder, match=r"missing")
        path.write_bytes(b"")
        assert_refused(folder)
        path.write_bytes(content)
    jl.open(folder)


def test_chunks_that_changed_places_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_CHUNK_BYTES", 12)
    monkeypatch.setattr(module, "_SHARD_CHUNKS", 1)
    write_capture(BITS, tmp_path / "a", name="zarr")
    (tmp_path / "a" / "c/0/0/0").rename(tmp_path / "b")
    (tmp_path / "a" / "c/1/0/0").rename(tmp_path / "a" / "c/0/0/0")
    (tmp_path / "b").rename(tmp_path / "a" / "c/1/0/0")
    with pytest.raises(ValueError, match="is not the chunk that jotlight wrote"):
        jl.open(tmp_path / "a").to_array()
    with pytest.raises(ValueError, match="is damaged; restore it from a copy"):
        verify_capture(tmp_path / "a")


def shard_of_bits(tmp_path, monkeypatch):
    """Return a folder of bits in several shards of several chunks."""
    monkeypatch.setattr(module, "_CHUNK_BYTES", 12)
    monkeypatch.setattr(module, "_SHARD_CHUNKS", 4)
    frames = np.random.default_rng(0).random((30, 6, 13)) < 0.4
    write_capture(jl.Bits.from_array(frames), tmp_path / "a", name="zarr")
    return tmp_path / "a", frames


def test_shards_are_read_as_a_whole_and_in_parts(tmp_path, monkeypatch):
    folder, frames = shard_of_bits(tmp_path, monkeypatch)
    assert zarr.open_array(str(folder), mode="r").shards == (4, 6, 2)
    bits = jl.open(folder)
    np.testing.assert_array_equal(bits.to_array(), frames)
    np.testing.assert_array_equal(bits[5:6].to_array(), frames[5:6])
    np.testing.assert_array_equal(bits[6:15].to_array(), frames[6:15])
    assert "match their checksums" in verify_capture(folder)


def test_shards_that_changed_places_are_refused(tmp_path, monkeypatch):
    folder, _ = shard_of_bits(tmp_path, monkeypatch)
    (folder / "c/0/0/0").rename(tmp_path / "b")
    (folder / "c/1/0/0").rename(folder / "c/0/0/0")
    (tmp_path / "b").rename(folder / "c/1/0/0")
    for frames in (slice(0, 1), slice(0, 4)):
        with pytest.raises(ValueError, match="jotlight wrote"):
            jl.open(folder)[frames].to_array()
    with pytest.raises(ValueError, match="is damaged; restore it from a copy"):
        verify_capture(folder)


def test_chunks_that_changed_places_in_a_shard_are_refused(tmp_path, monkeypatch):
    folder, _ = shard_of_bits(tmp_path, monkeypatch)
    path = folder / "c/0/0/0"
    content = bytearray(path.read_bytes())
    index = np.frombuffer(content[-68:-4], "<u8").reshape(4, 2)
    (first, size), (second, same) = index[:2].tolist()
    if size != same:
        pytest.skip("the chunks were compressed to different sizes")
    a, b = content[first : first + size], content[second : second + size]
    content[first : first + size], content[second : second + size] = b, a
    path.write_bytes(content)
    for frames in (slice(0, 1), slice(0, 4)):
        with pytest.raises(ValueError, match="jotlight wrote"):
            jl.open(folder)[frames].to_array()


@pytest.mark.slow
def test_flipped_bits_of_shards_are_refused(tmp_path, monkeypatch):
    folder, _ = shard_of_bits(tmp_path, monkeypatch)
    path = folder / "c/2/0/0"
    content = path.read_bytes()
    for bit in range(0, 8 * len(content), 29):
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        with pytest.raises(ValueError):  # noqa: PT011
            jl.open(folder).to_array()
        with pytest.raises(ValueError):  # noqa: PT011
            verify_capture(folder)
    for size in (0, 3, 30, len(content) - 5):
        path.write_bytes(content[:size])
        with pytest.raises(ValueError, match="c/2/0/0"):
            verify_capture(folder)


@pytest.mark.parametrize("data", [BITS, COUNTS], ids=["bits", "counts"])
def test_every_chunk_is_written_and_small(tmp_path, monkeypatch, data):
    monkeypatch.setattr(module, "_CHUNK_BYTES", 8)
    monkeypatch.setattr(module, "_SHARD_CHUNKS", 1)
    empty = jl.Bits(np.zeros_like(BITS.packed), 13) if data is BITS else np.zeros_like(COUNTS)
    for number, capture in enumerate([data, empty]):
        path = tmp_path / str(number)
        write_capture(capture, path, name="zarr")
        array = zarr.open_array(str(path), mode="r")
        assert array.nchunks_initialized == array.nchunks > 3
        assert np.prod(array.chunks) * array.dtype.itemsize <= 8
        assert [codec.to_dict()["name"] for codec in array.metadata.codecs][-1] == "crc32c"
        expected = capture.packed if data is BITS else capture
        np.testing.assert_array_equal(array[...], expected)
        found = jl.open(path)
        np.testing.assert_array_equal(found.packed if data is BITS else found, expected)


@pytest.mark.parametrize(
    ("shape", "itemsize", "chunks"),
    [
        ((1000, 512, 64), 1, (256, 512, 64)),
        ((3, 4, 5), 1, (3, 4, 5)),
        ((9, 10**5, 10**5), 1, (1, 83, 10**5)),
        ((20_000, 20_000), 4, (104, 20_000)),
        ((2, 3, 10**8), 4, (1, 1, 2**21)),
    ],
)
def test_chunks_have_at_most_8_mib(shape, itemsize, chunks):
    assert module._chunk_shape(shape, itemsize) == chunks


def test_zarr_itself_reads_the_folder_without_a_complaint(tmp_path):
    write_capture(BITS_WITH_MAPS, tmp_path / "a", name="zarr")
    group = zarr.open(str(tmp_path / "a"), mode="r")
    assert sorted(group.array_keys()) == ["bits", "dark_counts", "mask"]
    np.testing.assert_array_equal(group["mask"][...], BITS_WITH_MAPS.sensor.mask)
    np.testing.assert_array_equal(group["bits"][...], BITS.packed)


def test_files_that_the_list_does_not_name_are_ignored_unless_they_are_metadata(folder):
    expected = verify_capture(folder)
    for name in (".DS_Store", "c/notes.txt"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("x")
    assert verify_capture(folder) == expected
    shutil.copytree(folder, folder / "more")
    assert_refused(folder, match=r"more/.*zarr\.json: is not listed in jotlight\.json")


def test_metadata_that_zarr_consolidates_are_refused_as_changed(tmp_path):
    write_capture(BITS_WITH_MAPS, tmp_path / "a", name="zarr")
    with pytest.warns(UserWarning, match="Consolidated metadata"):
        zarr.consolidate_metadata(str(tmp_path / "a"))
    assert_refused(tmp_path / "a", match=r"zarr\.json: is damaged or was changed")


def test_an_array_without_its_list_of_files_is_refused(tmp_path):
    write_capture(BITS_WITH_MAPS, tmp_path / "a", name="zarr")
    with pytest.raises(ValueError, match="open the whole zarr folder"):
        jl.open(tmp_path / "a" / "bits")
    (tmp_path / "a" / "bits" / "jotlight.json").unlink()
    with pytest.raises(ValueError, match=r"its list of files jotlight\.json is missing"):
        jl.open(tmp_path / "a")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 2}, "expected format 'jotlight zarr', version 1"),
        ({"format": "other"}, "expected format 'jotlight zarr', version 1"),
        ({"more": 1}, "unknown entries more"),
        ({"chunks": []}, "expected metadata and chunks by name"),
        ({"chunks": {"c/0/0": 3}}, "damaged"),
        ({"chunks": {"c/0/0": "00"}}, "damaged|not the chunk"),
        ({"chunks": {"../b": "00"}}, "missing, such as ../b"),
        ({"chunks": {}}, "not the chunk|is missing"),
        ({"metadata": {}}, "is not listed"),
    ],
)
def test_invalid_lists_of_files_are_refused(tmp_path, changes, message):
    write_capture(COUNTS, tmp_path / "a", name="zarr")
    (tmp_path / "b").touch()
    path = tmp_path / "a" / "jotlight.json"
    content = json.loads(path.read_text())
    del content["checksum"]
    path.write_text(seal({**content, **changes}))
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "a")


def test_verification_counts_the_files(tmp_path):
    write_capture(BITS_WITH_MAPS, tmp_path / "a", name="zarr")
    assert verify_capture(tmp_path / "a").startswith("7 files match their checksums; all 3 frames")
