import io
import struct
import time
from functools import partial

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from jotlight import JotlightWarning
from jotlight.formats.files import limits
from jotlight.images.io import image_writer, read_image

GRAY = np.linspace(0, 1, 35, dtype=np.float32).reshape(5, 7)
COLOR = np.stack([GRAY, GRAY[::-1], 1 - GRAY], axis=-1)


@pytest.mark.parametrize("image", [GRAY, COLOR], ids=["gray", "color"])
@pytest.mark.parametrize(
    ("name", "depth", "error"),
    [
        ("a.png", 8, 0.5 / 255),
        ("a.png", 16, 0.5 / 65535),
        ("a.tif", 8, 0),
        ("a.npy", 8, 0),
        ("a.jpg", 8, 0.2),
    ],
)
def test_a_written_image_reads_back(tmp_path, image, name, depth, error):
    path = tmp_path / name
    image_writer(path, depth=depth)(path, image)
    again = read_image(path)
    assert again.shape == image.shape
    assert np.abs(again - image).max() <= error + 1e-6


@pytest.mark.parametrize("name", ["a.tif", "a.npy"])
def test_floats_are_never_clipped(tmp_path, name):
    bright = (GRAY * 1000).astype(np.float32)
    image_writer(tmp_path / name, white=1.0)(tmp_path / name, bright)
    assert (read_image(tmp_path / name) == bright).all()


def test_white_is_the_brightest_level_of_a_displayed_image(tmp_path):
    path = tmp_path / "a.png"
    image_writer(path, white=2.0)(path, np.array([[0.0, 1.0, 2.0, 3.0]]))
    assert np.asarray(Image.open(path)).tolist() == [[0, 128, 255, 255]]


@pytest.mark.parametrize(
    ("dtype", "known"),
    [(np.uint8, {"png": 255, "tif": 255, "npy": None}), (np.uint16, {"tif": None, "npy": None})],
)
def test_integers_of_unknown_scale_need_the_white_level(tmp_path, dtype, known):
    levels = np.arange(12, dtype=dtype).reshape(3, 4)
    for ending, scale in known.items():
        path = tmp_path / f"a.{ending}"
        if ending == "npy":
            np.save(path, levels)
        elif ending == "tif":
            tifffile.imwrite(path, levels)
        else:
            Image.fromarray(levels).save(path)
        if scale is None:
            with pytest.raises(ValueError, match="--white"):
                read_image(path)
        else:
            assert np.allclose(read_image(path), levels / scale)
        assert np.allclose(read_image(path, white=100), levels / 100)


def test_16_bit_gray_png_has_its_full_scale(tmp_path):
    path = tmp_path / "a.png"
    Image.fromarray(np.array([[0, 65535, 1000]], np.uint16)).save(path)
    assert np.allclose(read_image(path), [[0, 1, 1000 / 65535]])


def test_gray_is_the_luma_of_bt_601_rounded_to_a_level(tmp_path):
    path = tmp_path / "a.png"
    levels = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [10, 20, 30]]], np.uint8)
    Image.fromarray(levels).save(path)
    expected = np.rint(levels @ [0.299, 0.587, 0.114]) / 255
    assert np.allclose(read_image(path, gray=True), expected)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "CMYK"])
def test_every_mode_of_pillow_becomes_gray_or_color(tmp_path, mode):
    path = tmp_path / ("a.tiff" if mode == "CMYK" else "a.png")
    path = path.with_suffix(".jpg") if mode == "CMYK" else path
    Image.new("RGB", (6, 4), (200, 100, 50)).convert(mode).save(path)
    assert read_image(path).shape in ((4, 6), (4, 6, 3))


def test_the_exif_orientation_is_applied(tmp_path):
    path = tmp_path / "a.jpg"
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("L", (8, 4)).save(path, exif=exif)
    assert read_image(path).shape == (8, 4)


def test_an_image_that_would_fill_the_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    path = tmp_path / "bomb.jpg"
    Image.new("L", (40, 40)).save(path)
    with pytest.raises(ValueError, match=r"bomb\.jpg: expected an image of at most 200 pixels"):
        read_image(path)


def test_a_large_png_is_read_unless_it_is_compressed_very_well(tmp_path, monkeypatch):
    path = tmp_path / "large.png"
    Image.new("L", (40, 40)).save(path)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    assert read_image(path).shape == (40, 40)
    monkeypatch.setattr(limits, "_FREE_FRAME_BYTES", 100)
    monkeypatch.setattr(limits, "_MAX_FRAME_EXPANSION", 1)
    message = r"large\.png.*expected frames of at most 100 bytes, or 1 times .*, got 1600;"
    for read in (read_image, partial(jl.open, counts=True)):
        with pytest.raises(ValueError, match=message):
            read(path)


def test_the_error_of_a_damaged_file_names_it(tmp_path):
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, GRAY)
    for name, content in {
        "a.tif": buffer.getvalue()[:60],
        "b.tif": b"no tiff",
        "c.png": b"",
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ValueError, match=name):
            read_image(tmp_path / name)


@pytest.mark.parametrize("white", [0, -1, np.inf, np.nan])
def test_a_white_level_that_is_not_positive_and_finite_is_refused(tmp_path, white):
    np.save(tmp_path / "a.npy", GRAY)
    with pytest.raises(ValueError, match="white"):
        read_image(tmp_path / "a.npy", white=white)


COLORS = np.random.default_rng(0).integers(0, 256, (4, 5, 3), dtype=np.uint8)


def write_transparent(path, alpha):
    """Write an image with transparency in the format of its ending."""
    if path.suffix == ".exr":
        OpenEXR = pytest.importorskip("OpenEXR")
        pixels = np.dstack([COLORS, alpha]).astype(np.float32) / 255
        OpenEXR.File({}, {"RGBA": pixels}).write(str(path))
    elif path.suffix == ".tif":
        options = {"photometric": "rgb", "extrasamples": ["unassalpha"]}
        tifffile.imwrite(path, np.dstack([COLORS, alpha]), **options)
    elif path.name == "gray.png":
        Image.fromarray(np.dstack([COLORS[..., 0], alpha]), "LA").save(path)
    else:
        Image.fromarray(np.dstack([COLORS, alpha])).save(path)


@pytest.mark.parametrize("name", ["a.png", "gray.png", "a.tif", "a.exr"])
def test_transparent_pixels_are_warned_about(tmp_path, name):
    expected = COLORS[..., 0] / 255 if name == "gray.png" else COLORS / 255
    alpha = np.full((4, 5), 255, np.uint8)
    write_transparent(tmp_path / name, alpha)
    np.testing.assert_allclose(read_image(tmp_path / name), expected, atol=1e-6)
    alpha[1, 2:4] = 0, 128
    write_transparent(tmp_path / name, alpha)
    with pytest.warns(JotlightWarning, match=f"{name}: 2 of 20 pixels are transparent"):
        image = read_image(tmp_path / name)
    np.testing.assert_allclose(image, expected, atol=1e-6)


@pytest.mark.parametrize("ending", ["bmp", "pgm", "tif", "png", "npy"])
def test_no_image_is_mapped_into_memory(tmp_path, monkeypatch, ending):
    levels = np.random.default_rng(0).integers(0, 256, (300, 400), np.uint8)
    path = tmp_path / f"photo.{ending}"
    if ending == "npy":
        np.save(path, levels)
    else:
        Image.fromarray(levels).save(path)
    maps = []
    monkeypatch.setattr("mmap.mmap", lambda *args, **_: maps.append(args))
    image = read_image(path, white=255)
    np.testing.assert_allclose(image * 255, levels, atol=1e-3)
    assert maps == []


@pytest.mark.parametrize("image", [GRAY, COLOR], ids=["gray", "color"])
def test_exr_reads_back(tmp_path, image):
    exr = pytest.importorskip("OpenEXR")
    jl.save_image(tmp_path / "a.exr", 100 * image)
    again = read_image(tmp_path / "a.exr")
    assert again.dtype == np.float32
    np.testing.assert_array_equal(again, (100 * image).astype(np.float32))
    half = np.ascontiguousarray(image, np.float16)
    names = (
        {"Y": half} if image.ndim == 2 else {"RGBA": np.dstack([half, np.ones_like(half[..., :1])])}
    )
    header = {"compression": exr.PIZ_COMPRESSION, "type": exr.scanlineimage}
    exr.File(header, names).write(str(tmp_path / "half.exr"))
    np.testing.assert_array_equal(read_image(tmp_path / "half.exr"), half.astype(np.float32))


def test_damaged_and_other_exr_are_refused(tmp_path):
    exr = pytest.importorskip("OpenEXR")
    path = tmp_path / "a.exr"
    jl.save_image(path, COLOR)
    content = path.read_bytes()
    corner = struct.pack("<4i", 0, 0, 6, 4)
    assert content.count(corner) == 2  # the data window and the display window
    huge = content.replace(corner, struct.pack("<4i", 0, 0, 99_999, 99_999))
    for damaged in (b"", content[:200], content[:-20], b"x" + content, huge):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"a\.exr: the EXR file cannot be read"):
            read_image(path)
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    exr.File(header, {"Z": GRAY}).write(str(path))
    with pytest.raises(ValueError, match=r"expected the channel Y or R, G, and B, got \['Z'\]"):
        read_image(path)


def test_exr_without_its_package_names_the_extra(tmp_path, monkeypatch):
    (tmp_path / "a.exr").write_bytes(b"")
    monkeypatch.setattr("jotlight.images.exr.find_spec", lambda name: None)
    with pytest.raises(jl.MissingExtraError, match=r"jotlight\[exr\]"):
        read_image(tmp_path / "a.exr")


@pytest.mark.slow
@pytest.mark.parametrize("photo", ["camera", "astronaut"])
def test_a_png_is_written_as_fast_as_with_pillow(tmp_path, photo):
    image = np.rint(255 * jl.datasets.photograph(photo)).astype(np.uint8)
    runs = {
        "Pillow": lambda: Image.fromarray(image).save(tmp_path / "pillow.png"),
        "jotlight": lambda: jl.save_image(tmp_path / "jotlight.png", image),
    }
    best = dict.fromkeys(runs, np.inf)
    for _ in range(9):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], time.perf_counter() - start)
    assert best["jotlight"] < 1.1 * best["Pillow"]
    sizes = [(tmp_path / f"{name}.png").stat().st_size for name in ("jotlight", "pillow")]
    assert sizes[0] < 1.02 * sizes[1]


def test_arrays_in_npy_become_photographs(tmp_path):
    colors = np.random.default_rng(0).random((4, 5, 4))
    np.save(tmp_path / "a.npy", colors)
    np.testing.assert_array_equal(read_image(tmp_path / "a.npy"), colors)
    np.save(tmp_path / "a.npy", colors[..., :1])
    for gray in (False, True):
        np.testing.assert_array_equal(read_image(tmp_path / "a.npy", gray=gray), colors[..., 0])
    for wrong in (np.zeros(()), np.zeros(5), np.zeros((0, 4))):
        np.save(tmp_path / "a.npy", wrong)
        with pytest.raises(ValueError, match=r"expected an image of shape \(H, W\) or \(H, W, 3\)"):
            read_image(tmp_path / "a.npy")
