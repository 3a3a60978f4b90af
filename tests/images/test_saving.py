"""Images of any kind of number in one call."""

import numpy as np
import pytest
from PIL import Image

import jotlight as jl

RANDOM = np.random.default_rng(0)


def levels(path):
    return np.asarray(Image.open(path)).astype(float)


@pytest.mark.parametrize("shape", [(20, 30), (20, 30, 3)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_intensities_from_0_to_1_are_shown_as_they_are(tmp_path, shape, dtype):
    image = RANDOM.random(shape).astype(dtype)
    jl.save_image(tmp_path / "a.png", image)
    np.testing.assert_allclose(levels(tmp_path / "a.png") / 255, image, atol=0.5001 / 255)
    jl.save_image(tmp_path / "b.png", image, depth=16)
    np.testing.assert_allclose(jl.read_image(tmp_path / "b.png"), image, atol=0.5001 / 65535)


def test_bits_and_integers_of_photographs_have_their_full_scale(tmp_path):
    bits = RANDOM.random((9, 7)) < 0.5
    jl.save_image(tmp_path / "bits.png", bits)
    np.testing.assert_array_equal(levels(tmp_path / "bits.png"), 255 * bits)
    photo = RANDOM.integers(0, 256, (9, 7), np.uint8)
    jl.save_image(str(tmp_path / "photo.png"), photo)
    np.testing.assert_array_equal(levels(tmp_path / "photo.png"), photo)
    deep = RANDOM.integers(0, 65536, (9, 7), np.uint16)
    jl.save_image(tmp_path / "deep.png", deep, depth=16)
    np.testing.assert_array_equal(levels(tmp_path / "deep.png"), deep)


@pytest.mark.parametrize(
    "image",
    [
        RANDOM.integers(0, 40, (30, 40)),
        0.01 * RANDOM.random((30, 40)),
        50 * RANDOM.random((30, 40)),
    ],
)
def test_counts_and_dim_or_bright_images_are_exposed_with_a_warning(tmp_path, image):
    white = np.percentile(image, 99.5)
    with pytest.warns(jl.JotlightWarning, match=f"{white:.3g}, the 99.5th percentile"):
        jl.save_image(tmp_path / "a.png", image)
    expected = np.clip(image / white, 0, 1)
    np.testing.assert_allclose(levels(tmp_path / "a.png") / 255, expected, atol=0.5001 / 255)
    jl.save_image(tmp_path / "a.png", image, white=100.0)
    expected = np.clip(image / 100, 0, 1)
    np.testing.assert_allclose(levels(tmp_path / "a.png") / 255, expected, atol=0.5001 / 255)


def test_a_few_bright_pixels_do_not_change_an_ordinary_image(tmp_path):
    image = 0.4 * RANDOM.random((60, 80))
    image[5, 5] = 1.5
    with pytest.warns(jl.JotlightWarning, match="image: 1 is shown as white"):
        jl.save_image(tmp_path / "a.png", image)
    expected = np.clip(image, 0, 1)
    np.testing.assert_allclose(levels(tmp_path / "a.png") / 255, expected, atol=0.5001 / 255)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_small_integers_are_not_nearly_black(tmp_path, dtype):
    counts = RANDOM.integers(0, 17, (30, 40)).astype(dtype)
    with pytest.warns(jl.JotlightWarning, match="16, the 99.5th percentile, is shown as white"):
        jl.save_image(tmp_path / "a.png", counts)
    assert levels(tmp_path / "a.png").max() == 255


def test_a_black_image_is_black(tmp_path):
    with pytest.warns(jl.JotlightWarning, match="image: 1 is shown as white"):
        jl.save_image(tmp_path / "a.png", np.zeros((4, 4)))
    assert not levels(tmp_path / "a.png").any()


@pytest.mark.parametrize("options", [{}, {"white": 2.0}])
def test_negative_values_are_black_with_a_warning(tmp_path, options):
    image = np.linspace(-1, 1, 12).reshape(3, 4)
    message = "image: .* 0 or more .*, got 6 of 12 below 0, down to -1, .*; add an offset"
    with pytest.warns(jl.JotlightWarning, match=message):
        jl.save_image(tmp_path / "a.png", image, **options)
    assert not levels(tmp_path / "a.png").ravel()[:6].any()
    jl.save_image(tmp_path / "a.tif", image)
    jl.save_image(tmp_path / "b.png", np.maximum(image, -1e-3))


def test_one_channel_is_gray_and_integers_stay_integers(tmp_path):
    image = RANDOM.random((9, 7, 1))
    jl.save_image(tmp_path / "a.png", image)
    assert levels(tmp_path / "a.png").shape == (9, 7)
    counts = RANDOM.integers(0, 2**31 - 1, (9, 7), np.int32)
    jl.save_image(tmp_path / "a.npy", counts)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), counts)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (jl.Bits.from_array(np.eye(4, dtype=bool)), r"got Bits; take one frame, bits\[0\]"),
        (
            jl.Readings(np.eye(4, dtype=int), jl.Sensor(bit_depth=2)),
            r"got Readings; take one frame, readings\[0\], or readings\.sum\(\)",
        ),
        (
            jl.Merged(np.eye(4, dtype=int), 2, jl.Sensor(frames=2)),
            r"got Merged; take an estimate, such as jotlight\.reconstruct\(merged\)",
        ),
    ],
    ids=["bits", "readings", "merged"],
)
def test_data_are_refused_with_the_image_to_save(tmp_path, data, message):
    with pytest.raises(TypeError, match=message):
        jl.save_image(tmp_path / "a.png", data)


@pytest.mark.parametrize("name", ["a.tif", "a.npy"])
def test_numbers_for_measurements_are_not_clipped(tmp_path, name):
    image = (RANDOM.normal(size=(20, 30)) * 10).astype(np.float32)
    jl.save_image(tmp_path / name, image)
    np.testing.assert_array_equal(jl.read_image(tmp_path / name), image)


@pytest.mark.parametrize(
    ("image", "options", "error", "message"),
    [
        (np.zeros((2, 3, 4)), {}, ValueError, r"\(H, W, 3\), got .*; jotlight\.save_film writes"),
        (
            np.zeros((8, 9, 4)),
            {},
            ValueError,
            r"; if the fourth .* pass image\[\.\.\., :3\]$",
        ),
        (np.zeros(5), {}, ValueError, "expected shape"),
        (np.zeros((0, 5)), {}, ValueError, "expected shape"),
        ([["a"]], {}, TypeError, "array of numbers"),
        (np.full((2, 2), np.nan), {}, ValueError, "finite values"),
        (np.ones((2, 2)), {"white": 0.0}, ValueError, "white: expected"),
        (np.ma.ones((2, 2)), {}, TypeError, r"got a masked one; pass image\.filled\(0\)"),
        (np.ones((2, 2)), {"white": "1"}, ValueError, "white: expected a finite number .* '1'"),
        (np.ones((2, 2)), {"depth": 12}, ValueError, "depth: expected 8, or 16"),
    ],
)
def test_wrong_images_are_refused_and_nothing_is_written(tmp_path, image, options, error, message):
    with pytest.raises(error, match=message):
        jl.save_image(tmp_path / "a.png", image, **options)
    with pytest.raises(ValueError, match=r"ends in \.png"):
        jl.save_image(tmp_path / "a.gif", np.ones((2, 2)))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [bool, np.float32, np.float64])
@pytest.mark.parametrize("shape", [(9, 7), (9, 7, 3)])
def test_an_array_of_numbers_keeps_its_type_and_is_read_back(tmp_path, kind, shape):
    image = (RANDOM.random(shape) < 0.5).astype(kind)
    jl.save_image(tmp_path / "a.npy", image)
    assert np.load(tmp_path / "a.npy").dtype == kind
    np.testing.assert_array_equal(jl.read_image(tmp_path / "a.npy"), image)
    assert jl.read_image(tmp_path / "a.npy", gray=True).shape == (9, 7)


def test_channels_on_the_first_axis_have_advice(tmp_path):
    with pytest.raises(ValueError, match=r"got \(3, 8, 9\).*pass np\.moveaxis\(image, 0, -1\)$"):
        jl.save_image(tmp_path / "a.png", np.ones((3, 8, 9)))
    with pytest.raises(ValueError, match=r"got \(5, 8, 9\).*a stack of images$"):
        jl.save_image(tmp_path / "a.png", np.ones((5, 8, 9)))
