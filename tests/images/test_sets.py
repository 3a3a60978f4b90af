from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight
from jotlight.errors import JotlightWarning
from jotlight.images.io import read_image
from jotlight.images.sets import ENDINGS, read_image_set, require_image_list

LEVELS = np.random.default_rng(0).integers(0, 256, (12, 15), np.uint8)
COLOR = np.random.default_rng(1).integers(0, 256, (12, 15, 3), np.uint8)


@pytest.fixture
def folder(tmp_path):
    """A folder with one image per format. Their names do not sort in the order of creation."""
    folder = tmp_path / "images"
    folder.mkdir()
    np.save(folder / "f.npy", LEVELS / np.float32(255))
    Image.fromarray(LEVELS).save(folder / "c.png")
    Image.fromarray(LEVELS).save(folder / "a.bmp")
    Image.fromarray(LEVELS).save(folder / "e.pgm")
    tifffile.imwrite(folder / "d.tif", LEVELS)
    Image.fromarray(LEVELS).save(folder / "b.PNG")
    Image.fromarray(LEVELS).save(folder / "g.webp", lossless=True)
    return folder


def test_images_of_every_format_are_sorted_by_name(folder):
    names, images = read_image_set(folder)
    assert names == ["a.bmp", "b.PNG", "c.png", "d.tif", "e.pgm", "f.npy", "g.webp"]
    for image in images:
        assert image.dtype == np.float32
        assert image.flags.c_contiguous
        np.testing.assert_allclose(image, LEVELS / 255, atol=1e-7)


def test_a_path_may_be_a_string(folder):
    assert read_image_set(str(folder))[0] == read_image_set(folder)[0]


def test_hidden_files_and_other_endings_are_left_out(folder):
    before = read_image_set(folder)[0]
    (folder / ".hidden.png").write_bytes(b"no image")
    (folder / "notes.txt").write_text("no image")
    (folder / "noending").write_text("no image")
    (folder / "video.mp4").write_text("no image")
    (folder / "below").mkdir()
    Image.fromarray(LEVELS).save(folder / "below" / "deeper.png")
    assert read_image_set(folder)[0] == before


def test_images_of_several_sizes_keep_theirs(folder):
    Image.fromarray(LEVELS[:5, :3]).save(folder / "c.png")
    assert {image.shape for image in read_image_set(folder)[1]} == {(12, 15), (5, 3)}


@pytest.mark.parametrize("name", ["color.png", "color.tif"])
def test_color_becomes_the_luma_of_bt_601_in_whole_levels(tmp_path, name):
    if name.endswith("png"):
        Image.fromarray(COLOR).save(tmp_path / name)
    else:
        tifffile.imwrite(tmp_path / name, COLOR, photometric="rgb")
    red, green, blue = np.moveaxis(COLOR.astype(float), 2, 0)
    luma = np.rint(0.299 * red + 0.587 * green + 0.114 * blue) / 255
    [image] = read_image_set(tmp_path)[1]
    np.testing.assert_allclose(image, luma, atol=1e-7)
    swapped = np.rint(0.299 * blue + 0.587 * green + 0.114 * red) / 255
    assert np.abs(image - swapped).max() > 0.05


@pytest.mark.parametrize("first", [1, 3, 7, 100])
def test_first_takes_the_first_by_name_and_reads_no_others(folder, first):
    names, images = read_image_set(folder)
    some, theirs = read_image_set(folder, first=first)
    assert some == names[:first]
    assert len(theirs) == len(some) == min(first, 7)
    (folder / "g.webp").write_text("no image")
    if first < 7:
        assert read_image_set(folder, first=first)[0] == some
    np.testing.assert_array_equal(theirs[0], images[0])


@pytest.mark.parametrize("first", [0, -1])
def test_first_below_1_is_refused(folder, first):
    with pytest.raises(ValueError, match=f"first: expected at least 1 image, got {first}"):
        read_image_set(folder, first=first)


def test_progress_is_reported_to_the_end(folder):
    shares = []
    read_image_set(folder, progress=shares.append)
    np.testing.assert_allclose(shares, np.arange(1, 8) / 7)


def save_as(path, stack):
    if path.suffix == ".npz":
        np.savez(path, stack)
    else:
        np.save(path, stack)
    return path


@pytest.mark.parametrize("ending", [".npy", ".npz"])
@pytest.mark.parametrize("kind", [np.uint8, np.float16, np.float32, np.float64])
def test_an_array_of_images_is_read_with_the_scale_of_its_kind(tmp_path, ending, kind):
    stack = np.stack([LEVELS, LEVELS[::-1]])
    stored = stack if kind == np.uint8 else (stack / 255).astype(kind)
    names, images = read_image_set(save_as(tmp_path / f"a{ending}", stored))
    assert names == ["0", "1"]
    for image, levels in zip(images, stack, strict=True):
        assert image.dtype == np.float32
        np.testing.assert_allclose(image, levels / 255, atol=5e-4 if kind == np.float16 else 1e-7)


def test_names_of_an_array_sort_like_its_images(tmp_path):
    path = save_as(tmp_path / "a.npy", np.zeros((101, 2, 3), np.float32))
    names, _ = read_image_set(path)
    assert names == sorted(names)
    assert (names[0], names[-1]) == ("000", "100")
    names, images = read_image_set(path, first=3)
    assert names == ["0", "1", "2"]
    assert len(images) == 3


@pytest.mark.parametrize("kind", [np.uint16, np.int32, np.int64])
def test_other_whole_numbers_need_the_white_level(tmp_path, kind):
    stack = np.arange(24, dtype=kind).reshape(2, 3, 4)
    path = save_as(tmp_path / "a.npy", stack)
    with pytest.raises(ValueError, match=rf"a\.npy: the scale of {stack.dtype} is unknown"):
        read_image_set(path)
    images = read_image_set(path, white=23)[1]
    np.testing.assert_allclose(images, stack / 23, rtol=1e-6)


@pytest.mark.parametrize("largest", [1, 15])
@pytest.mark.parametrize("ending", [".npy", ".npz"])
def test_bits_and_small_readings_of_8_bits_need_the_white_level(tmp_path, largest, ending):
    path = save_as(tmp_path / f"a{ending}", np.full((2, 3, 4), largest, np.uint8))
    message = rf"uint8 with values up to {largest} is unknown; .*white= .*jotlight\.open reads it"
    with pytest.raises(ValueError, match=message):
        read_image_set(path)
    np.testing.assert_array_equal(read_image_set(path, white=largest)[1], np.ones((2, 3, 4)))


def test_a_black_image_and_a_description_by_another_program_are_no_capture(tmp_path):
    images = np.zeros((2, 3, 4), np.uint8)
    images[1] = 200
    np.save(tmp_path / "a.npy", images)
    (tmp_path / "a.json").write_text('{"camera": "mine"}')
    assert [image.max() for image in read_image_set(tmp_path / "a.npy", first=1)[1]] == [0]


@pytest.mark.parametrize("bit_depth", [1, 4, 8])
def test_a_capture_of_jotlight_is_no_set_of_images(tmp_path, bit_depth):
    sensor = jotlight.Sensor(frames=4, gain=4 * 2**bit_depth, bit_depth=bit_depth)
    capture = sensor.expose(np.full((8, 16), 0.9), rng=0)
    jotlight.save(capture, tmp_path / "a.npy")
    kind = "bits" if bit_depth == 1 else "readings"
    for white in (None, 255):
        with pytest.raises(ValueError, match=rf"a\.npy: .* got jotlight {kind}, according to a"):
            read_image_set(tmp_path / "a.npy", white=white)


def test_counts_of_jotlight_are_no_set_of_images(tmp_path):
    jotlight.save(np.full((8, 16), 200, np.uint8), tmp_path / "a.npy")
    with pytest.raises(ValueError, match=r"a\.npy: .* got jotlight counts, according to a\.json"):
        read_image_set(tmp_path / "a.npy")


def test_white_scales_images_and_floats_too(tmp_path):
    path = save_as(tmp_path / "a.npy", np.full((2, 3, 4), 5.0))
    np.testing.assert_array_equal(read_image_set(path, white=10)[1], np.full((2, 3, 4), 0.5))
    Image.fromarray(LEVELS).save(tmp_path / "b.png")
    path.unlink()
    np.testing.assert_allclose(read_image_set(tmp_path, white=100)[1][0], LEVELS / 100, rtol=1e-6)


@pytest.mark.parametrize("white", [0, -1.0, np.nan, np.inf, "1", [1, 2]])
def test_a_white_level_that_is_not_positive_and_finite_is_refused(tmp_path, white):
    path = save_as(tmp_path / "a.npy", np.zeros((2, 3, 3)))
    for read in (read_image_set, read_image):
        with pytest.raises(ValueError, match="white: expected a finite number above 0, got "):
            read(path, white=white)


def test_a_key_chooses_an_array_of_several(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, one=np.zeros((2, 3, 4)), two=np.ones((5, 3, 4)))
    assert len(read_image_set(path, key="two")[1]) == 5
    with pytest.raises(ValueError, match=r"a\.npz: expected key= \(--key\) to name .*one, two$"):
        read_image_set(path)
    with pytest.raises(ValueError, match="one, two; got 'three'"):
        read_image_set(path, key="three")


def test_a_key_is_refused_unless_the_file_is_an_npz(folder, tmp_path):
    path = save_as(tmp_path / "a.npy", np.zeros((2, 3, 4)))
    for source in (folder, path):
        with pytest.raises(ValueError, match=r"key: names an array in a \.npz"):
            read_image_set(source, key="a")


def test_the_error_of_a_missing_path_names_it(tmp_path):
    for name in ("none", "none.npy", "none.npz"):
        with pytest.raises(FileNotFoundError, match=rf"there is no folder or file .*{name}$"):
            read_image_set(tmp_path / name)


def test_the_error_of_a_folder_without_images_names_the_endings(tmp_path):
    (tmp_path / "notes.txt").write_text("no image")
    with pytest.raises(ValueError, match="expected images") as caught:
        read_image_set(tmp_path)
    assert str(tmp_path) in str(caught.value)
    assert all(ending in str(caught.value) for ending in ENDINGS)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("ca.png", b"no image", "no known format"),
        ("ca.tif", b"no image", "cannot be read"),
        ("ca.npy", b"no array", "does not begin like one"),
        ("ca.jpg", b"", "no known format"),
    ],
)
def test_the_error_of_an_unreadable_image_names_it(folder, name, content, message):
    (folder / name).write_bytes(content)
    with pytest.raises(ValueError, match=rf"images/{name}: .*{message}"):
        read_image_set(folder)


def test_the_error_of_a_truncated_image_names_it(folder):
    whole = (folder / "c.png").read_bytes()
    (folder / "c.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"c\.png: the image cannot be read"):
        read_image_set(folder)


@pytest.mark.parametrize("shape", [(7,), (2, 3, 4, 3), (3, 4, 2), (0, 4), (4, 0, 3)])
def test_an_array_in_a_folder_must_be_an_image(folder, shape):
    np.save(folder / "f.npy", np.zeros(shape, np.float32))
    with pytest.raises(ValueError, match=r"f\.npy: expected"):
        read_image_set(folder)


@pytest.mark.parametrize("ending", [".npy", ".npz"])
def test_python_objects_are_refused(tmp_path, ending):
    path = save_as(tmp_path / f"a{ending}", np.array([[[{}]]], dtype=object))
    with pytest.raises(ValueError, match="Python objects, which can run code and are never read"):
        read_image_set(path)


@pytest.mark.parametrize(
    "stack",
    [
        np.zeros((0, 3, 4)),
        np.zeros((2, 0, 4)),
        np.zeros((3, 4)),
        np.zeros((2, 3, 4, 3)),
        np.zeros((2, 3, 4), bool),
        np.zeros((2, 3, 4), complex),
        np.full((2, 3, 4), "a"),
    ],
    ids=lambda stack: f"{stack.dtype} {stack.shape}",
)
@pytest.mark.parametrize("ending", [".npy", ".npz"])
def test_an_array_of_another_shape_or_type_is_refused(tmp_path, stack, ending):
    path = save_as(tmp_path / f"a{ending}", stack)
    message = rf"a\{ending}: expected .*gray images \(N, H, W\)"
    with pytest.raises(ValueError, match=message):
        read_image_set(path)


@pytest.mark.parametrize("shape", [(8, 9, 3), (2, 8, 9, 3), (2, 3, 8, 9), (2, 1, 8, 9)])
def test_the_advice_about_channels_returns_a_stack(tmp_path, shape):
    stack = np.random.default_rng(0).random(shape)
    with pytest.raises(ValueError, match="images of their own: write ") as caught:
        read_image_set(save_as(tmp_path / "a.npy", stack))
    converted = eval(str(caught.value).partition(" write ")[2], {"np": np, "array": stack})
    assert converted.shape == (stack.size // 72, 8, 9)
    _, images = read_image_set(save_as(tmp_path / "b.npy", converted))
    np.testing.assert_array_equal(images, converted.astype(np.float32))


def test_the_error_of_a_value_that_is_no_intensity_names_the_file(tmp_path):
    image = np.full((8, 9), np.nan)
    (tmp_path / "folder").mkdir()
    save_as(tmp_path / "folder" / "a.npy", image)
    for source in save_as(tmp_path / "a.npy", image[None]), tmp_path / "folder":
        with pytest.raises(ValueError, match=r"a\.npy: expected finite intensities"):
            read_image_set(source)


def test_the_error_of_a_folder_of_folders_names_one(tmp_path):
    (tmp_path / "more").mkdir()
    with pytest.raises(ValueError, match=r"found none; folders inside .* pass one: .*more"):
        read_image_set(tmp_path)


def test_a_single_image_is_refused_as_a_set(tmp_path):
    Image.fromarray(LEVELS).save(tmp_path / "a.png")
    with pytest.raises(ValueError, match=r"a\.png: expected a folder of images, a \.npy"):
        read_image_set(tmp_path / "a.png")


@pytest.mark.parametrize("name", ["a.npy", "a.npz"])
def test_an_array_of_gray_levels_is_reported_with_its_level(tmp_path, name):
    path = save_as(tmp_path / name, np.full((2, 6, 6), 200.0))
    with pytest.warns(JotlightWarning, match=r"a\.np.: most .* pass white=255 \(--white 255\)"):
        read_image_set(path)
    assert read_image_set(path, white=255)[1][0].max() < 1
    assert read_image_set(path, max_intensity=255)[1][0].max() == 200


@pytest.mark.parametrize("folder", ["folder", Path("folder")])
def test_a_path_in_place_of_images_is_named(folder):
    with pytest.raises(TypeError, match="images: expected an array, got the path 'folder'; pass"):
        require_image_list(folder)


class Sized:
    """An object with a length, but without elements."""

    def __len__(self):
        return 1


@pytest.mark.parametrize("images", [None, 3, (image for image in ()), Sized()])
def test_images_need_a_length_and_elements(images):
    with pytest.raises(TypeError, match=r"an array \(N, H, W\) or a list of images, got"):
        require_image_list(images)
