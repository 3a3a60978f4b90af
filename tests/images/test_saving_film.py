"""Films of any kind of number in one call."""

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.formats.reading import open_capture

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


def test_intensities_are_shown_as_they_are_or_with_another_white(tmp_path):
    images = np.random.default_rng(0).random((3, 9, 7))
    jl.save_film(tmp_path / "a.gif", images)
    np.testing.assert_allclose(levels(tmp_path / "a.gif", 1), 255 * images[1], atol=0.6)
    jl.save_film(tmp_path / "b.gif", images, white=0.5)
    expected = 255 * np.minimum(2 * images[1], 1)
    np.testing.assert_allclose(levels(tmp_path / "b.gif", 1), expected, atol=0.6)


def test_the_samples_of_a_sequence_reach_its_end(tmp_path):
    images = np.ones((5, 4, 6))
    images[4] = 7
    with pytest.warns(jl.JotlightWarning, match="images: 7"):
        jl.save_film(tmp_path / "a.gif", images)


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
        (np.ones((2, 3)), {}, ValueError, r"expected shape .* got \(3,\)"),
        ([["a"]], {}, TypeError, "array of numbers"),
        (np.ones((2, 3, 4)), {"white": -1.0}, ValueError, "white: expected"),
        (np.ones((2, 3, 4)), {"fps": 0}, ValueError, "fps: expected"),
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
