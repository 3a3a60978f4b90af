"""Films of any kind of number in one call."""

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.formats.reading import open_capture
from jotlight.motion.films.film import film

SENSOR = jl.Sensor(frames=12)
BITS = SENSOR.expose(np.linspace(0, 1, 600).reshape(20, 30), rng=0)
COUNTS = np.stack([part.counts() for part in BITS.windows(4)])


def levels(path, number):
    with Image.open(path) as film:
        film.seek(number)
        return np.asarray(film.convert("L")).astype(float)


@pytest.mark.parametrize("as_film", [lambda x: x, list, iter, lambda x: (each for each in x)])
def test_counts_are_exposed_with_a_warning_and_share_one_white(tmp_path, as_film):
    with pytest.warns(jl.JotlightWarning, match="images: 4, the 99.5th percentile, is shown as w"):
        jl.save_film(tmp_path / "a.gif", as_film(COUNTS))
    for number, counts in enumerate(COUNTS):
        np.testing.assert_allclose(levels(tmp_path / "a.gif", number), counts / 4 * 255, atol=0.6)


def test_frames_of_bits_are_black_and_white(tmp_path):
    jl.save_film(str(tmp_path / "a.gif"), BITS)
    for number, frame in enumerate(BITS):
        np.testing.assert_array_equal(levels(tmp_path / "a.gif", number), 255 * frame)


def test_images_of_counts_that_were_opened_are_filmed(tmp_path):
    np.save(tmp_path / "counts.npy", COUNTS.astype(np.uint16))
    stack = open_capture(tmp_path / "counts.npy")
    assert isinstance(stack, CountStack)
    jl.save_film(tmp_path / "a.tif", stack)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tif"), COUNTS)
    with pytest.warns(jl.JotlightWarning, match="is shown as white"):
        jl.save_film(tmp_path / "film", stack)
    assert len(list((tmp_path / "film").iterdir())) == 3


def test_frames_of_readings_are_exposed_like_an_array(tmp_path):
    values = np.zeros((4, 9, 4), np.uint8)
    values[0], values[2] = 2, 8
    readings = jl.Readings(values, jl.Sensor(frames=4, gain=20, bit_depth=4))
    done = []
    with pytest.warns(jl.JotlightWarning, match="images: 8, the 99.5th percentile") as warned:
        jl.save_film(tmp_path / "a.gif", readings, progress=done.append)
    assert len(warned) == 1
    assert done == [0.25, 0.5, 0.75, 1]
    for number, level in enumerate((2, 0, 8, 0)):
        np.testing.assert_allclose(levels(tmp_path / "a.gif", number), 255 * level / 8, atol=0.6)


def test_intensities_are_shown_as_they_are_or_with_another_white(tmp_path):
    images = np.random.default_rng(0).random((3, 9, 7))
    jl.save_film(tmp_path / "a.gif", images)
    np.testing.assert_allclose(levels(tmp_path / "a.gif", 1), 255 * images[1], atol=0.6)
    jl.save_film(tmp_path / "b.gif", images, white=0.5)
    expected = 255 * np.minimum(2 * images[1], 1)
    np.testing.assert_allclose(levels(tmp_path / "b.gif", 1), expected, atol=0.6)


@pytest.mark.parametrize("as_film", [np.asarray, list])
@pytest.mark.parametrize("flash", [1, 3, 4])
def test_no_image_of_a_sequence_is_clipped(tmp_path, as_film, flash):
    images = np.full((5, 4, 6), 0.5)
    images[flash] = 7
    with pytest.warns(jl.JotlightWarning, match="images: 7, the 99.5th percentile") as warned:
        jl.save_film(tmp_path / "a.gif", as_film(images))
    assert len(warned) == 1
    np.testing.assert_allclose(levels(tmp_path / "a.gif", 0), 255 / 14, atol=0.6)


def test_dark_images_do_not_change_the_white_of_others(tmp_path):
    images = np.stack([np.zeros((9, 7)), np.full((9, 7), 0.01), np.full((9, 7), 0.02)])
    with pytest.warns(jl.JotlightWarning, match="images: 0.02, the"):
        jl.save_film(tmp_path / "dim.gif", images)
    jl.save_film(tmp_path / "full.gif", np.concatenate([images, np.ones((1, 9, 7))]))
    with pytest.warns(jl.JotlightWarning, match="images: 1 is shown as white"):
        jl.save_film(tmp_path / "black.gif", images[:1])


def test_a_generator_that_becomes_brighter_is_clipped_with_one_warning(tmp_path):
    images = np.full((4, 5, 6, 3), 0.5)
    images[2, :3, :, 1], images[3] = 2, 7
    message = (
        "images: 80 % of the pixels of 2 images, the first of them image 2, are brighter than "
        r"white, 1; white=7 \(--white 7\) shows the largest value, or pass a list of all images"
    )
    with pytest.warns(jl.JotlightWarning, match=message) as warned:
        jl.save_film(tmp_path / "a.gif", iter(images))
    assert len(warned) == 1
    with pytest.warns(jl.JotlightWarning, match="images: 60 % of the pixels of image 2 are"):
        jl.save_film(tmp_path / "b.gif", iter(images[:3]))
    jl.save_film(tmp_path / "c.gif", iter(images), white=1.0)
    jl.save_film(tmp_path / "d.npy", iter(images))


def test_a_generator_that_starts_dark_is_clipped_with_a_warning(tmp_path):
    with (
        pytest.warns(jl.JotlightWarning, match="images: 0.01, the 99.5th percentile"),
        pytest.warns(jl.JotlightWarning, match="100 % of the pixels of image 1 are .*white=0.5"),
    ):
        jl.save_film(tmp_path / "a.gif", (np.full((9, 7), level) for level in (0.01, 0.5)))


def test_a_generator_whose_noise_varies_is_written_without_a_warning_about_clipping(tmp_path):
    images = np.random.default_rng(0).poisson(3.0, (6, 24, 30)) / 10
    images[1, :1] = 9
    with pytest.warns(jl.JotlightWarning, match="is shown as white") as warned:
        jl.save_film(tmp_path / "a.gif", iter(images / 40))
    assert len(warned) == 1


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("name", ["a.gif", "a.npy"])
def test_one_color_image_is_not_a_film(tmp_path, name, channels):
    image = np.ones((8, 9, channels))
    with pytest.raises(ValueError, match=r"\(8, 9, \d\) looks like one color image; pass a list"):
        jl.save_film(tmp_path / name, image)
    jl.save_film(tmp_path / name, [image[..., :3]])
    jl.save_film(tmp_path / name, list(image))
    jl.save_film(tmp_path / name, jl.Bits.from_array(image > 0))


def test_progress_is_reported_for_a_known_number_of_images(tmp_path):
    done = []
    jl.save_film(tmp_path / "a.npy", COUNTS, progress=done.append)
    assert done == [1 / 3, 2 / 3, 1]


@pytest.mark.parametrize("name", ["a.npy", "a.gif"])
@pytest.mark.parametrize(
    ("images", "options", "error", "message"),
    [
        ([], {}, ValueError, "at least one"),
        (iter(()), {}, ValueError, "at least one"),
        (np.zeros((2, 3, 4, 5)), {}, ValueError, r"expected shape \(H, W\) or \(H, W, 3\), got"),
        (
            np.ones((2, 3)),
            {},
            ValueError,
            r"got one image of shape \(2, 3\); pass a list, \[image\]",
        ),
        ([["a"]], {}, TypeError, "array of numbers"),
        (np.ones((2, 3, 4)), {"white": -1.0}, ValueError, "white: expected"),
        (np.ones((2, 3, 4)), {"fps": 0}, ValueError, "fps: expected"),
        (np.ma.ones((2, 3, 4)), {}, TypeError, "image: .* got a masked one"),
        (np.ones((2, 3, 4)), {"white": "1"}, ValueError, "white: expected a finite number .* '1'"),
        (np.ones((2, 3, 4)), {"fps": "25"}, ValueError, "fps: expected .* per second, got '25'"),
        (np.ones((2, 3, 4)), {"fps": None}, ValueError, "fps: expected .* per second, got None"),
        (np.ones((2, 3, 4)), {"progress": 3}, TypeError, "progress: expected"),
        ([np.ones((3, 4)), np.ones((4, 3))], {}, ValueError, "one shape for all"),
    ],
)
def test_wrong_films_are_refused_and_nothing_is_written(
    tmp_path, name, images, options, error, message
):
    with pytest.raises(error, match=message):
        jl.save_film(tmp_path / name, images, **options)
    assert list(tmp_path.iterdir()) == []


def test_values_that_cannot_be_displayed_are_refused(tmp_path):
    images = [np.ones((3, 4)), np.full((3, 4), np.nan)]
    with pytest.raises(ValueError, match="finite values"):
        jl.save_film(tmp_path / "a.gif", images)
    jl.save_film(tmp_path / "a.npy", images)
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy"]
    with pytest.raises(ValueError, match="expected a name for a film"):
        jl.save_film(tmp_path / "a.avi", images)


def test_the_first_image_with_negative_values_is_reported(tmp_path):
    images = np.full((3, 9, 7), 0.5)
    images[1:, 0] = -0.25
    with pytest.warns(jl.JotlightWarning) as warnings:
        jl.save_film(tmp_path / "a.gif", images, white=1)
    [message] = [str(warning.message) for warning in warnings]
    assert message.startswith("images[1]: expected values of 0 or more for display, got 7 of 63")
    jl.save_film(tmp_path / "a.tif", images, white=1)


@pytest.mark.parametrize("name", [".", "..", "old", "old.set"])
def test_a_folder_is_refused_with_the_name_of_a_file_in_it(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    for each in ("old", "old.set"):
        (tmp_path / each).mkdir()
    with pytest.raises(IsADirectoryError, match=r"it is a folder; name .*film\.gif, or a new"):
        jl.save_film(name, np.zeros((2, 3, 4)))
    with pytest.raises(IsADirectoryError, match=r"it is a folder; name .*image\.png$"):
        jl.save_image(name, np.zeros((3, 4)))


@pytest.mark.parametrize(
    ("images", "advice"),
    [
        (jl.merge_readings(BITS), r"images: .* got Merged; take .*jotlight\.reconstruct\(merged\)"),
        (
            [jl.merge_readings(BITS)],
            r"image: .* got Merged; take .*jotlight\.reconstruct\(merged\)",
        ),
        (BITS.windows(4), r"image: .* got Bits; take one frame, bits\[0\], or bits\.counts\(\)"),
        ([jl.uncertainty(BITS)], r"got Uncertainty; take .* uncertainty\.standard_error"),
        ([SENSOR], "expected an array of numbers, got Sensor"),
    ],
)
def test_what_is_no_image_is_refused_with_the_image_to_save(tmp_path, images, advice):
    with pytest.raises(TypeError, match=advice):
        jl.save_film(tmp_path / "a.gif", images)
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore:expected 16 or more frames")
def test_the_images_of_a_film_along_a_motion_are_estimated_first(tmp_path):
    with pytest.raises(TypeError, match=r"got FilmImage; take .*reconstruct\(image\.data\)"):
        jl.save_film(tmp_path / "a.gif", film(BITS, window=12))
