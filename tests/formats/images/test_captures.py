"""Counts in TIFF and PNG files, and masks."""

import numpy as np
import png
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from jotlight.formats.images import captures
from jotlight.formats.reading import open_capture
from jotlight.images.io import image_writer

COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_tiff_holds_one_image_or_a_stack(tmp_path, compression, order):
    options = {"photometric": "minisblack", "compression": compression, "byteorder": order}
    tifffile.imwrite(tmp_path / "a.tif", COUNTS, **options)
    with pytest.warns(jl.JotlightWarning, match="sum of its 5 images"):
        counts = jl.open(tmp_path / "a.tif")
    np.testing.assert_array_equal(counts, COUNTS.sum(0))
    part = jl.open(tmp_path / "a.tif", frames=slice(1, 3))
    np.testing.assert_array_equal(part, COUNTS[1:3].sum(0))
    tifffile.imwrite(tmp_path / "a.tif", COUNTS[0], **options)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif"), COUNTS[0])


def test_a_tiff_holds_color_counts(tmp_path):
    image = COUNTS[:, :, :3]
    tifffile.imwrite(tmp_path / "a.tif", image, photometric="rgb")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif"), image)


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_columns_of_narrow_images_are_not_channels(tmp_path, width):
    image = COUNTS[0, :, :width].astype(np.int32)
    for name in ("a.tif", "a.png"):
        jl.save(image, tmp_path / name)
        np.testing.assert_array_equal(jl.open(tmp_path / name), image)
    for frames in (1, 3):
        sensor = jl.Sensor(frames=frames, bit_depth=9)
        for array in (COUNTS[:frames, :, :width], COUNTS[:frames, :, :width, None].repeat(3, 3)):
            jl.save(jl.Readings(array, sensor), tmp_path / "r.tif")
            opened = jl.open(tmp_path / "r.tif")
            assert opened.sensor == sensor
            np.testing.assert_array_equal(np.asarray(opened), array)


@pytest.mark.parametrize("depth", [1, 2, 4, 8, 16])
def test_a_folder_of_png_is_decoded_when_it_is_read(tmp_path, monkeypatch, depth):
    levels = COUNTS & ((1 << depth) - 1)
    for number, image in enumerate(levels):
        png.from_array(image.tolist(), f"L;{depth}").save(tmp_path / f"{number}.png")
    decoded = []
    decode = captures._decode_png
    monkeypatch.setattr(
        captures, "_decode_png", lambda content: decoded.append(0) or decode(content)
    )
    opened = open_capture(tmp_path)
    assert decoded == []
    found = opened.to_array() if depth == 1 else opened.images.read(0, 5)
    np.testing.assert_array_equal(found, levels)
    assert len(decoded) == 5
    (tmp_path / "3.png").write_bytes((tmp_path / "3.png").read_bytes()[:-9])
    opened = open_capture(tmp_path)
    with pytest.raises(ValueError, match=r"3\.png: the PNG cannot be read"):
        opened.sum() if depth > 1 else opened.counts()
    Image.new("RGB", (7, 6)).save(tmp_path / "4.png")
    with pytest.raises(ValueError, match=r"4\.png: .*expected gray levels, got color"):
        open_capture(tmp_path)


def test_floats_are_refused_as_counts(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.ones((4, 5), np.float32))
    with pytest.raises(ValueError, match="floats are an image of intensities"):
        jl.open(tmp_path / "a.tif")


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("in_folder", [False, True])
def test_an_estimate_is_no_capture_unless_the_caller_says_so(tmp_path, depth, in_folder):
    note = {"capture": "night.npy", "method": "mle", "sensor": {"frames": 4}}
    image = np.linspace(0, 1, 42).reshape(6, 7)
    path = tmp_path if in_folder else tmp_path / "b.png"
    jl.save(COUNTS[0, :, :7].astype(np.int32), tmp_path / "a.png")
    for content in (note, {"jotlight": {"run": note}}):
        image_writer("b.png", depth=depth, note=content)(tmp_path / "b.png", image)
        with pytest.raises(ValueError, match=r"b\.png: .* made of night\.npy by mle; .*--counts"):
            jl.open(path)
    read = jl.open(tmp_path / "b.png", counts=True)
    np.testing.assert_array_equal(read, np.rint(image * (2**depth - 1)))


def test_notes_of_other_programs_are_no_estimates(tmp_path):
    for note in ({"method": "sum"}, {"jotlight": 1}, {"jotlight": {"run": "mle"}}):
        image_writer("a.png", note=note)(tmp_path / "a.png", np.full((6, 7), 0.5))
        assert jl.open(tmp_path / "a.png").max() == 128


@pytest.mark.parametrize("depth", [1, 2, 4, 8, 16])
def test_a_png_of_every_depth_is_read(tmp_path, depth):
    levels = np.random.default_rng(0).integers(0, 2**depth, (6, 11), np.uint16)
    with (tmp_path / "a.png").open("wb") as file:
        png.Writer(11, 6, greyscale=True, bitdepth=depth).write(file, levels.tolist())
    read = jl.open(tmp_path / "a.png")
    if depth == 1:
        np.testing.assert_array_equal(read.to_array()[0], levels)
    else:
        np.testing.assert_array_equal(read, levels)


def test_the_indices_into_a_palette_are_counts(tmp_path):
    levels = np.random.default_rng(0).integers(0, 16, (6, 11), np.uint8)
    with (tmp_path / "a.png").open("wb") as file:
        colors = [(16 * level, 0, 255 - level) for level in range(16)]
        png.Writer(11, 6, palette=colors, bitdepth=4).write(file, levels.tolist())
    np.testing.assert_array_equal(jl.open(tmp_path / "a.png"), levels)


def test_a_folder_of_images_is_in_natural_order(tmp_path):
    for number, image in enumerate(COUNTS):
        Image.fromarray(image).save(tmp_path / f"{number + 8}.png")
    with pytest.warns(jl.JotlightWarning, match="sum of its 5 images"):
        np.testing.assert_array_equal(jl.open(tmp_path), COUNTS.sum(0))
    np.testing.assert_array_equal(jl.open(tmp_path, frames=slice(2, 3)), COUNTS[2])
    Image.fromarray(COUNTS[0, :2]).save(tmp_path / "20.png")
    with pytest.raises(ValueError, match="one size"):
        jl.open(tmp_path)


def test_a_color_png_is_refused(tmp_path):
    Image.fromarray(np.zeros((4, 5, 3), np.uint8)).save(tmp_path / "a.png")
    with pytest.raises(ValueError, match="expected gray levels"):
        jl.open(tmp_path / "a.png")


@pytest.mark.parametrize(("levels", "is_bits"), [(COUNTS[0], False), (COUNTS[0] > 150, True)])
@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_images_of_counts_are_not_bits_and_the_reverse(tmp_path, levels, is_bits, name):
    if name == "a.png":
        Image.fromarray(levels).save(tmp_path / name)
    elif is_bits:
        tifffile.imwrite(tmp_path / name, np.stack([levels] * 5), photometric="minisblack")
    else:
        tifffile.imwrite(tmp_path / name, levels, photometric="minisblack")
    with pytest.raises(ValueError, match=f"counts: .* holds {'bits' if is_bits else 'counts'}"):
        jl.open(tmp_path / name, counts=is_bits)
    same = jl.open(tmp_path / name, counts=not is_bits)
    assert isinstance(same, jl.Bits) == is_bits


def test_channels_that_are_stored_apart_are_no_frames(tmp_path):
    apart = np.moveaxis(COUNTS[:, :, :3], -1, 0)
    options = {"photometric": "rgb", "planarconfig": "separate"}
    tifffile.imwrite(tmp_path / "a.tif", apart, **options)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif"), COUNTS[:, :, :3])
    tifffile.imwrite(tmp_path / "a.tif", np.stack([apart, apart + 1]), **options)
    with pytest.warns(jl.JotlightWarning, match="sum of its 2 images"):
        np.testing.assert_array_equal(jl.open(tmp_path / "a.tif"), 2 * COUNTS[:, :, :3] + 1)


def test_the_error_of_many_channels_says_what_to_do(tmp_path):
    options = {"imagej": True, "metadata": {"axes": "TCYX"}}
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((5, 2, 6, 7), np.uint8), **options)
    with pytest.raises(ValueError, match="write each to a file of its own"):
        jl.open(tmp_path / "a.tif")


def test_the_error_of_images_that_differ_names_two_of_them(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", COUNTS[0], photometric="minisblack")
    tifffile.imwrite(tmp_path / "b.tif", COUNTS[0, :5], photometric="minisblack")
    with pytest.raises(ValueError, match=r"got uint16 .*\(6, 7\) in a\.tif, .*\(5, 7\) in b\.tif"):
        jl.open(tmp_path)
