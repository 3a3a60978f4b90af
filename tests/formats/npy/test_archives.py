"""Archives of arrays that jotlight writes: their label and their checksum."""

import io
import zipfile

import numpy as np
import pytest

import jotlight as jl
from examples.encodings import npy_bytes
from jotlight.formats.npy.archives import (
    describe_npz_arrays,
    read_npz,
    read_npz_label,
    verify_npz,
)

COUNTS = np.random.default_rng(0).integers(0, 300, (6, 7), np.int32)


@pytest.fixture
def saved(tmp_path):
    jl.save(COUNTS, tmp_path / "a.npz")
    return tmp_path / "a.npz"


def test_numpy_opens_an_archive_with_a_checksum(saved):
    with np.load(saved, allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["counts"], COUNTS)
    assert verify_npz(saved) == 1
    assert "jotlight counts" in read_npz_label(saved)


def test_equal_counts_yield_equal_archives(saved, tmp_path):
    jl.save(COUNTS, tmp_path / "b.npz")
    assert saved.read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_an_archive_of_another_program_has_no_checksum(tmp_path):
    np.savez(tmp_path / "a.npz", a=COUNTS)
    assert verify_npz(tmp_path / "a.npz") == 0
    assert read_npz_label(tmp_path / "a.npz") is None


def test_arrays_of_one_name_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", npy_bytes(COUNTS))
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("a.npy", npy_bytes(COUNTS + 1))
    with pytest.raises(ValueError, match=r"a\.npz: .*got several arrays a; save them again"):
        jl.open(tmp_path / "a.npz")


def test_an_archive_whose_checksum_was_removed_is_refused(saved):
    with zipfile.ZipFile(saved, "a") as archive:
        archive.comment = b""
    with pytest.raises(ValueError, match=r"a\.npz: expected a checksum at its end"):
        jl.open(saved)


def test_an_archive_that_another_program_extended_is_refused(saved):
    with zipfile.ZipFile(saved, "a") as archive:
        archive.writestr("more", b"1")
    with pytest.raises(ValueError, match=r"a\.npz: is damaged or was changed"):
        jl.open(saved)


def test_an_array_that_ends_before_its_member_is_refused(tmp_path):
    file = io.BytesIO()
    np.save(file, COUNTS)
    content = file.getvalue().replace(b"(6, 7)", b"(5, 7)")
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", content)
    for read in (read_npz, jl.open):
        with pytest.raises(ValueError, match="more bytes follow than the header"):
            read(tmp_path / "a.npz")


@pytest.mark.parametrize("excess", [1, 2_000_000_000])
def test_a_member_that_claims_more_bytes_than_its_file_is_refused(tmp_path, excess):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, a=COUNTS)
    content = bytearray(path.read_bytes())
    place = content.rindex(b"PK\1\2") + 20
    content[place : place + 4] = (len(content) + excess).to_bytes(4, "little")
    path.write_bytes(content)
    for read in (read_npz, jl.open):
        with pytest.raises(ValueError, match=r"a\.npz: .*claims \d+ compressed bytes"):
            read(path)


def test_a_member_that_goes_beyond_the_end_of_its_file_is_an_error_with_a_reason(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, a=COUNTS)
    content = bytearray(path.read_bytes().replace(b"(6, 7)", b"(9, 9)"))
    place = content.rindex(b"PK\1\2") + 20
    content[place : place + 8] = 2 * len(content).to_bytes(4, "little")
    path.write_bytes(content)
    # Newer releases of Python notice earlier that the member reaches into what follows it.
    reason = r"a\.npz: .*\((it ends too early|Overlapped entries.*)\)"
    for read in (read_npz, jl.open):
        with pytest.raises(ValueError, match=reason):
            read(path)


def test_an_archive_is_not_opened_again_for_each_array(tmp_path, monkeypatch):
    opened = []

    class Counting(zipfile.ZipFile):
        def __init__(self, *args):
            opened.append(args)
            super().__init__(*args)

    np.savez(tmp_path / "a.npz", *[COUNTS] * 20)
    monkeypatch.setattr(zipfile, "ZipFile", Counting)
    described = describe_npz_arrays(tmp_path / "a.npz")
    assert described == {f"arr_{number}": (COUNTS.shape, COUNTS.dtype) for number in range(20)}
    assert len(opened) == 2


def test_an_archive_of_too_many_arrays_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for number in range(1001):
            archive.writestr(f"a{number}.npy", b"")
    for read in (describe_npz_arrays, read_npz, jl.open):
        with pytest.raises(ValueError, match=r"a\.npz: expected at most 1000 arrays, got 1001"):
            read(tmp_path / "a.npz")


def test_a_file_that_is_no_archive_is_refused_with_its_name(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((4, 4), int))
    with pytest.raises(ValueError, match=r"a\.npy: damaged or truncated \(File is not a zip"):
        jl.open(tmp_path / "a.npy", format="npz")
