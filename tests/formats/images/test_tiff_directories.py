"""TIFF files with invalid directories."""

import base64
import contextlib
import logging
import zlib

import numpy as np
import pytest
import tifffile

import jotlight as jl
from jotlight.formats.images.tiff_directories import check_directories
from jotlight.images.io import read_image

COUNTS = np.random.default_rng(0).integers(0, 2, (5, 17, 21), np.uint8)


def write_tiff(path, **options):
    tifffile.imwrite(path, COUNTS, photometric="minisblack", compression="zlib", **options)
    return path.read_bytes()


@pytest.mark.parametrize("fill", [bytes(8), b"\1" * 8, b"II*\0\x08\0\0\0"])
def test_a_file_with_inserted_bytes_is_read_or_refused(tmp_path, fill):
    whole = write_tiff(tmp_path / "a.tif")
    for place in range(4, 60):
        (tmp_path / "a.tif").write_bytes(whole[:place] + fill + whole[place:])
        for read in (jl.open, read_image):
            with contextlib.suppress(ValueError):
                read(tmp_path / "a.tif")


def test_directories_that_form_a_cycle_are_refused(tmp_path, run):
    whole = write_tiff(tmp_path / "a.tif")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        first, last = file.pages[0].offset, file.pages[4].offset
        tags = len(file.pages[4].tags)
    end = last + 2 + 12 * tags
    content = whole[:end] + first.to_bytes(4, "little") + whole[end + 4 :]
    (tmp_path / "a.tif").write_bytes(content)
    for read in (jl.open, read_image):
        with pytest.raises(ValueError, match="overlap, form a cycle"):
            read(tmp_path / "a.tif")
    status, said = run("info", "a.tif")
    assert status == 1
    assert "form a cycle" in said


def test_a_truncated_stack_is_refused(tmp_path):
    whole = write_tiff(tmp_path / "a.tif")
    (tmp_path / "a.tif").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="damaged or truncated"):
        jl.open(tmp_path / "a.tif")


def test_tags_cannot_make_a_file_be_read_many_times(tmp_path):
    tag = b"\0\1" + (2).to_bytes(2, "little") + (90_000).to_bytes(4, "little") + bytes(4)
    page = (800).to_bytes(2, "little") + 800 * tag + bytes(4)
    (tmp_path / "a.tif").write_bytes(b"II*\0" + (8).to_bytes(4, "little") + page + bytes(90_000))
    with pytest.raises(ValueError, match="more bytes than it has"):
        check_directories(tmp_path / "a.tif")


@pytest.mark.parametrize("options", [{"bigtiff": True}, {"byteorder": ">"}])
def test_intact_files_are_read(tmp_path, options):
    write_tiff(tmp_path / "a.tif", **options)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif", frames=slice(None)), COUNTS.sum(0))


def test_smaller_copies_of_a_page_are_not_frames(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(COUNTS, photometric="minisblack", subifds=2)
        for _ in range(2):
            file.write(COUNTS[:, ::2, ::2], photometric="minisblack", subfiletype=1)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif", frames=slice(None)), COUNTS.sum(0))


def test_other_files_that_a_file_names_are_not_opened(tmp_path):
    tifffile.imwrite(tmp_path / "b.ome.tif", COUNTS)
    words = (
        '<OME><Image ID="Image:0"><Pixels DimensionOrder="XYCZT" ID="Pixels:0" SizeC="1" '
        'SizeT="5" SizeX="21" SizeY="17" SizeZ="1" Type="uint8"><TiffData IFD="0" PlaneCount="5">'
        '<UUID FileName="b.ome.tif">urn:uuid:1</UUID></TiffData></Pixels></Image></OME>'
    )
    tifffile.imwrite(tmp_path / "a.ome.tif", COUNTS[0] * 0 + 7, description=words, metadata=None)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.ome.tif"), 7)


def test_what_tifffile_logs_is_not_printed(tmp_path, monkeypatch, capsys):
    content = bytearray(write_tiff(tmp_path / "a.tif"))
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        content[file.pages[0].tags["Software"].offset + 2] = 99  # no type has this number
    (tmp_path / "a.tif").write_bytes(content)
    monkeypatch.setattr(logging.getLogger("tifffile"), "propagate", False)
    jl.open(tmp_path / "a.tif", frames=slice(0, 1))
    assert capsys.readouterr().err == ""


# Fuzzing found this file: one of its pages claims two thousand million rows.
LARGE_PAGE = (
    "eNq9k01LwzAYx9N2k1nKmDAV9FJ6EqEvaV2VYQfiC1RQD7KLJ0OXbMW1HWkL9iL4Afw6Cn46067D6uZBJ0v4P/k9kD"
    "wJyT+uuw8aAIAmAFwNcIzWmbiS60w8JxTcYhJKzrVW4SbHgxM2vjJtlGvvWdiszNmq1Nwu+Y5ph6sXbLOwW3KPhb3K"
    "WsjqS2y8YEnIA+AGaIgvHahBiEQ/T2LHEr0RCkM8znGUTTCNE+Q9OAlNsRhEA+wMKcpiD42xCJZs3DclPiHEH2Ntks"
    "3NXF1/Xuluf+nSTy57AW/Tm2w9FS5rLHLZzFnvv3RWTfh0liR8dVZbmH9Naam/MDtlm/+/Uy7w3CTTIjrUb70RDlCs"
    "31yd66YBbdWw9SjA2mM8UOR+3z1zlJSG3TT1B12DmASSDlJx5+BQhZBA9chCWDVM4hnTBhX5lGKURNRRKqaWTcO0NU"
    "uzlN5x8ffkvHBBXUORr1GAixR8ANYfUnQ="
)


def test_a_page_larger_than_its_series_is_refused_before_memory_is_taken(tmp_path):
    path = tmp_path / "a.tif"
    content = zlib.decompress(base64.b64decode(LARGE_PAGE))
    path.write_bytes(content.replace(b"channels=3", b"frames=003"))  # pages of channels are refused
    with pytest.raises(ValueError, match=r"a\.tif: .*expected pages of shape"):
        jl.open(path, frames=slice(0, 3))
