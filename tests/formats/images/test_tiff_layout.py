"""TIFF files whose pages or samples are no counts are refused."""

import numpy as np
import pytest
import tifffile

import jotlight as jl
from jotlight.formats.reading import open_capture

VALUES = np.random.default_rng(0).integers(0, 16, (4, 3, 8, 9), np.uint8)
ALPHA = {"photometric": "minisblack", "extrasamples": ["unassalpha"]}


@pytest.mark.parametrize(
    ("name", "values", "options", "message"),
    [
        ("c.tif", VALUES[0], {"imagej": True, "metadata": {"axes": "CYX"}}, "3 channels"),
        ("tc.tif", VALUES, {"imagej": True, "metadata": {"axes": "TCYX"}}, "3 channels"),
        ("c.ome.tif", VALUES[0], {"ome": True, "metadata": {"axes": "CYX"}}, "3 channels"),
        ("tc.ome.tif", VALUES, {"ome": True, "metadata": {"axes": "TCYX"}}, "3 channels"),
        ("tz.tif", VALUES, {"imagej": True, "metadata": {"axes": "TZYX"}}, "one axis of images"),
        ("ga.tif", VALUES[0, :2].transpose(1, 2, 0), ALPHA, "1 channel and transparency"),
        ("gs.tif", VALUES[0, :2], {**ALPHA, "planarconfig": "separate"}, "1 channel and transp"),
        (
            "4.tif",
            VALUES[:, 0],
            {**ALPHA, "photometric": "rgb"},
            "transparency.*; if they are frames",
        ),
        ("gt.tif", VALUES[:, :2].transpose(0, 2, 3, 1), ALPHA, "1 channel and transparency"),
        (
            "rgba.tif",
            VALUES[:, 0].transpose(1, 2, 0),
            {"photometric": "rgb", "extrasamples": ["assocalpha"]},
            "3 channels and transparency",
        ),
        ("white.tif", VALUES[0, 0], {"photometric": "miniswhite"}, "inverted gray levels"),
        ("bool.tif", VALUES[0] > 7, {}, "inverted gray levels; .*photometric='minisblack'"),
        ("many.tif", np.tile(VALUES, (1, 2, 1, 1)), {"imagej": True}, "6 channels"),
        ("inks.tif", VALUES[:, 0].transpose(1, 2, 0), {"photometric": "separated"}, "inks"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_no_count_is_refused(tmp_path, name, values, options, message):
    tifffile.imwrite(tmp_path / name, values, **options)
    with pytest.raises(ValueError, match=rf"{name}: expected .*{message}"):
        jl.open(tmp_path / name)


@pytest.mark.parametrize("axes", ["TYX", "ZYX"])
@pytest.mark.parametrize("kind", ["imagej", "ome"])
def test_stacks_of_other_programs_are_frames(tmp_path, axes, kind):
    path = tmp_path / ("a.ome.tif" if kind == "ome" else "a.tif")
    tifffile.imwrite(path, VALUES[:, 0], metadata={"axes": axes}, **{kind: True})
    with pytest.warns(jl.JotlightWarning, match="sum of its 4 images"):
        np.testing.assert_array_equal(jl.open(path), VALUES[:, 0].sum(axis=0))


@pytest.mark.parametrize("kind", ["imagej", "ome"])
def test_more_pages_than_channels_are_frames_although_tifffile_calls_them_channels(tmp_path, kind):
    path = tmp_path / ("a.ome.tif" if kind == "ome" else "a.tif")
    frames = VALUES.reshape(12, 8, 9) > 7
    tifffile.imwrite(path, frames.astype(np.uint8), **{kind: True})
    bits = jl.open(path, unpacked=True)
    np.testing.assert_array_equal(bits.to_array(), frames)
    assert "its 12 pages are read as frames, although the file calls them channels" in str(
        bits.provenance.notes
    )
    with pytest.warns(jl.JotlightWarning, match="sum of its 12 images of counts; its 12 pages are"):
        np.testing.assert_array_equal(jl.open(path), frames.sum(axis=0))


def test_planes_that_tifffile_calls_colors_have_a_note(tmp_path):
    frames = VALUES.reshape(12, 8, 9)[:3]
    tifffile.imwrite(tmp_path / "a.tif", frames, photometric="rgb", planarconfig="separate")
    stack = open_capture(tmp_path / "a.tif")
    assert stack.images.shape == (1, 8, 9, 3)
    assert "its 3 planes are read as channels; if they are frames" in str(stack.provenance.notes)
    tifffile.imwrite(tmp_path / "a.tif", frames, photometric="minisblack")
    stack = open_capture(tmp_path / "a.tif")
    np.testing.assert_array_equal(np.asarray(stack.images), frames)
    assert "planes" not in str(stack.provenance.notes)


@pytest.mark.parametrize("kind", ["imagej", "ome"])
def test_colors_as_samples_are_channels(tmp_path, kind):
    path = tmp_path / ("a.ome.tif" if kind == "ome" else "a.tif")
    values = np.moveaxis(VALUES, 1, -1)
    tifffile.imwrite(path, values, photometric="rgb", metadata={"axes": "TYXS"}, **{kind: True})
    with pytest.warns(jl.JotlightWarning, match="sum of its 4 images"):
        np.testing.assert_array_equal(jl.open(path), values.sum(axis=0))


def test_own_files_of_four_channels_are_read(tmp_path):
    counts = np.moveaxis(VALUES[:, 0], 0, -1).astype(np.int32)
    jl.save(counts, tmp_path / "own.tif")
    np.testing.assert_array_equal(jl.open(tmp_path / "own.tif"), counts)
