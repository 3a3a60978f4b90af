"""Channels of images: files hold no channel that other programs take for transparency."""

import numpy as np
import pytest

from jotlight.images.image_stack import stack_writer
from jotlight.images.io import image_writer, read_image
from jotlight.images.video import video_writer

RAMP = np.linspace(0, 1, 96, dtype=np.float32).reshape(8, 12, 1)

FLOATS = ["a.tif", "a.exr"]
DISPLAYED = ["a.png", "a.jpg"]
FILMS = ["a.gif", "a.mp4", "a"]


def require(name):
    if name.endswith(".exr"):
        pytest.importorskip("OpenEXR")
    if name.endswith(".mp4"):
        pytest.importorskip("imageio_ffmpeg")


@pytest.mark.parametrize("name", [*FLOATS, *DISPLAYED])
def test_a_single_channel_is_a_gray_image(tmp_path, name):
    require(name)
    image_writer(name)(tmp_path / name, RAMP)
    found = read_image(tmp_path / name)
    assert found.shape == (8, 12)
    np.testing.assert_allclose(found, RAMP[..., 0], atol=0 if name in FLOATS else 0.02)


def test_an_array_keeps_a_single_channel(tmp_path):
    image_writer("a.npy")(tmp_path / "a.npy", RAMP)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), RAMP)


@pytest.mark.parametrize("channels", [2, 4])
@pytest.mark.parametrize("name", ["a.exr", *DISPLAYED])
def test_two_and_four_channels_are_no_image_for_display(tmp_path, name, channels):
    require(name)
    write = image_writer(tmp_path / name)
    with pytest.raises(ValueError, match=rf"{name}: expected a gray .* got {channels} channels"):
        write(tmp_path / name, np.repeat(RAMP, channels, axis=2))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("channels", [2, 4])
def test_a_tiff_holds_two_and_four_channels(tmp_path, channels):
    image = np.concatenate([RAMP + number for number in range(channels)], axis=2)
    image_writer("a.tif")(tmp_path / "a.tif", image)
    found = read_image(tmp_path / "a.tif")
    np.testing.assert_array_equal(found, image[..., : found.shape[2]])


@pytest.mark.parametrize("name", ["a.tif", *FILMS])
def test_a_film_of_a_single_channel_is_gray(tmp_path, name):
    require(name)
    for shape, folder in (RAMP.shape, "one"), (RAMP.shape[:2], "gray"):
        (tmp_path / folder).mkdir()
        with video_writer(tmp_path / folder / name, 2) as add:
            add(RAMP.reshape(shape))
            add(RAMP.reshape(shape) / 2)
    files = [
        sorted(path for path in (tmp_path / folder).rglob("*") if path.is_file())
        for folder in ("one", "gray")
    ]
    for one, gray in zip(*files, strict=True):
        assert one.read_bytes() == gray.read_bytes()


@pytest.mark.parametrize("channels", [2, 4])
@pytest.mark.parametrize("name", FILMS)
def test_two_and_four_channels_are_no_film(tmp_path, name, channels):
    """Their last channel would be transparency, and an mp4 would show other pixels."""
    require(name)
    with (
        pytest.raises(ValueError, match=f"expected a gray .* got {channels} channels"),
        video_writer(tmp_path / name, 1) as add,
    ):
        add(np.repeat(RAMP, channels, axis=2))
    assert list(tmp_path.iterdir()) == []


def test_named_images_of_a_single_channel_are_gray_pages(tmp_path):
    stack_writer("a.tif")(tmp_path / "a.tif", {"low": RAMP, "high": RAMP + 1})
    found = read_image(tmp_path / "a.tif")
    np.testing.assert_array_equal(found, np.stack([RAMP[..., 0], RAMP[..., 0] + 1]))
