"""The stage of the page in Chromium shows images of unusual sizes, and all of their flags."""

import io

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.view.viewed import Viewed
from waiting import wait_for

pytestmark = pytest.mark.slow

COLORED = """() => {
  const canvas = document.getElementById("image");
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let number = 0;
  for (let i = 0; i < data.length; i += 4)
    if (Math.max(...data.slice(i, i + 3)) - Math.min(...data.slice(i, i + 3)) > 100) number += 1;
  return number;
}"""
"""The number of visible pixels with a strong color, which is that of a flag."""

HEIGHT = """() => {
  const canvas = document.getElementById("image");
  const copy = new OffscreenCanvas(1, canvas.height).getContext("2d");
  copy.drawImage(canvas, -Math.floor(canvas.width / 2), 0);
  const words = new Uint32Array(copy.getImageData(0, 0, 1, canvas.height).data.buffer);
  return words.filter((word) => word !== words[0]).length;
}"""
"""The number of visible rows of the image."""


@pytest.fixture
def shown(opened, started):
    """Open the page with an image of some size."""

    def shown(shape, state="", **options):
        scene = np.random.default_rng(0).uniform(0.3, 0.7, shape).astype(np.float32)
        bits = jl.Sensor(frames=4, **options).expose(scene, rng=0)
        return opened(f"method=mle&white=1&{state}", at=started(Viewed.from_data(bits)))

    return shown


def percent(tab):
    return int(tab.locator("#zoom-value").inner_text().removesuffix(" %"))


def test_zooming_in_never_makes_a_tiny_image_smaller(shown):
    tab = shown((3, 3))
    fitted = percent(tab)
    tab.keyboard.press("+")
    assert percent(tab) >= fitted


def test_a_thin_image_is_visible_and_can_be_pointed_at(shown):
    tab = shown((1, 4096))
    assert percent(tab) < 100
    assert tab.evaluate(HEIGHT) >= 4
    box = tab.locator("#image").bounding_box()
    for above in (2, -2):
        tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + above)
        tab.locator("#readout", has_text="0, 20").wait_for()
        tab.mouse.move(2, 2)
        tab.locator("#readout", has_text="0, 20").wait_for(state="detached")
    tab.keyboard.press("1")
    assert tab.evaluate(HEIGHT) == 1


def test_a_flag_of_a_reduced_image_keeps_its_color(shown):
    mask = np.zeros((1600, 1600), bool)
    mask[801, 801] = True
    tab = shown(mask.shape, "overlays=jots", mask=mask)
    tab.locator("#jots-note", has_text="1, ").wait_for()
    assert percent(tab) < 50
    assert tab.evaluate(COLORED) == 4


def test_flags_of_jots_that_are_smaller_than_a_screen_pixel_are_visible(shown):
    mask = np.zeros((1200, 1200), bool)
    mask[1::4, 1::400] = mask[2::4, 202::400] = True
    tab = shown((150, 150), "overlays=jots", mask=mask, oversampling=8)
    tab.locator("#jots-note", has_text=f"{mask.sum()}, ").wait_for()
    assert 100 < percent(tab) < 800
    assert tab.evaluate(COLORED) > mask.sum()


def white_pixels(tab):
    """Return where the frame of the keyboard's pointer is, whose color the image does not have."""
    image = Image.open(io.BytesIO(tab.locator("#image").screenshot())).convert("RGB")
    return np.argwhere(np.all(np.asarray(image) == 255, axis=2))


def test_the_image_follows_the_pointer_of_the_keyboard(shown):
    tab = shown((200, 240), "curve=linear")
    fitted = percent(tab)
    tab.keyboard.press("i")
    tab.keyboard.press("Home")
    tab.set_viewport_size({"width": 900, "height": 700})
    wait_for(lambda: percent(tab) < fitted)  # it still fits
    for _ in range(4):
        tab.keyboard.press("+")
    for key in ("ArrowUp", "End", "Home"):
        tab.keyboard.press(key)
        tab.wait_for_timeout(100)
        rows, columns = white_pixels(tab).T
        assert np.ptp(rows) > 20, key
        assert np.ptp(columns) > 20, key
