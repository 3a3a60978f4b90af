"""The page in Chromium with larger text, and with the colors of the system."""

import io

import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.slow

KINDS = ("dead", "hot", "saturated", "uncertainty")


def colors(locator):
    """Return how many pixels of an element on the screen have each color."""
    image = Image.open(io.BytesIO(locator.screenshot())).convert("RGB")
    _, number = np.unique(np.asarray(image).reshape(-1, 3), axis=0, return_counts=True)
    return number


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_parts_that_are_only_a_color_are_visible_in_forced_colors(opened, scheme):
    tab = opened("method=mle", forced_colors="active", color_scheme=scheme)
    for name in ("#exposure", "#window", *(f".swatch.{each}" for each in KINDS)):
        assert len(colors(tab.locator(name))) > 1, name
    pressed, usual = (
        tab.locator(name).evaluate("e => getComputedStyle(e).backgroundColor")
        for name in ("#auto", "#copy-link")
    )
    assert pressed != usual


def test_the_firing_rate_is_visible_in_the_window_in_forced_colors(opened):
    tab = opened("method=mle&window=300", forced_colors="active")
    tab.locator("#timeline-caption", has_text="at each point").wait_for()
    inside = tab.evaluate("""() => {
      const canvas = document.getElementById("timeline");
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      const words = new Uint32Array(data.buffer);
      return words.reduce((sum, word) => sum + (word === words[0] ? 1 : 0), 0) / words.length;
    }""")
    assert 0.5 < inside < 0.99


LARGE_TEXT = """html { font-size: 200%; } * {
  letter-spacing: 0.12em !important; word-spacing: 0.16em !important; line-height: 1.5 !important;
}"""


def test_no_text_of_the_time_is_lost_when_text_is_large(opened):
    tab = opened("method=mle&window=64", bypass_csp=True)
    tab.add_style_tag(content=LARGE_TEXT)
    outer = tab.locator(".time").bounding_box()
    for name in ("#range", "#rate", "#window-number"):
        part = tab.locator(name)
        inner = part.bounding_box()
        assert inner["width"] > 0, name
        assert inner["x"] + inner["width"] <= outer["x"] + outer["width"], name
        assert part.evaluate("e => e.scrollWidth <= e.clientWidth || !e.clientWidth"), name


def test_plots_have_the_resolution_of_their_new_size(opened):
    tab = opened("method=mle&window=64", bypass_csp=True)
    tab.add_style_tag(content=LARGE_TEXT)
    for name in ("image", "timeline", "histogram"):
        tab.wait_for_function(
            """(name) => {
              const { width, height, clientWidth, clientHeight } = document.getElementById(name);
              return width === clientWidth && height === clientHeight;
            }""",
            arg=name,
        )
