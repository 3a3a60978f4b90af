"""The page in Chromium for brackets of exposures, and for readings of several bits."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.view.viewed import Viewed
from painted import final

pytestmark = pytest.mark.slow


def serve(sensor):
    pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
    from view_servers import serving

    return serving(Viewed.from_data(sensor.expose(np.full((32, 32), 0.5), rng=0)))


@pytest.fixture(scope="module")
def bracket():
    with serve(jl.Sensor(frames=96, gain=[0.5, 1.0, 2.0] * 32)) as running:
        yield running


@pytest.fixture(scope="module")
def several():
    with serve(jl.Sensor(frames=32, bit_depth=4, oversampling=2)) as running:
        yield running


def test_keys_move_by_whole_cycles(opened, bracket):
    tab = opened("method=mle&white=1", at=bracket)
    assert final(tab, start=0)["window"] == 63
    for key, start, window in (
        ("ArrowRight", 3, 63),
        ("End", 33, 63),
        ("[", 48, 33),
        ("Shift+ArrowLeft", 15, 33),
        ("ArrowLeft", 12, 33),
        ("Home", 0, 33),
    ):
        tab.keyboard.press(key)
        final(tab, start=start, window=window)
    assert tab.locator("#range").inner_text() == "Frames 0 – 32 · 11 cycles of 3 exposures"


def test_a_typed_window_becomes_whole_cycles_and_the_page_says_so(opened, bracket):
    tab = opened("method=mle&white=1", at=bracket)
    tab.locator("#window-number").fill("50")
    tab.keyboard.press("Enter")
    assert final(tab, window=51)["start"] % 3 == 0
    tab.locator("#toast", has_text="The exposures repeat every 3 frames").wait_for()
    assert tab.locator("#window-number").input_value() == "51"


def test_a_dragged_slider_stops_at_whole_cycles(opened, bracket):
    tab = opened("method=mle&white=1&window=30", at=bracket)
    box = tab.locator("#start").bounding_box()
    tab.mouse.move(box["x"] + 4, box["y"] + 20)
    tab.mouse.down()
    tab.mouse.move(box["x"] + box["width"] / 3, box["y"] + 20, steps=10)
    tab.mouse.up()
    final(tab, start=int(tab.locator("#start").input_value()))
    starts = {header["start"] for header in tab.evaluate("painted")}
    assert len(starts) > 1
    assert {start % 3 for start in starts} == {0}


def test_an_address_of_other_windows_is_named(opened, bracket):
    tab = opened("method=mle&start=4&window=20", at=bracket)
    assert final(tab, start=0)["window"] == 63
    note = tab.locator("#address-note").inner_text()
    assert "start=4 (expected a multiple of the 3 exposures)" in note
    assert "window=20 (expected a multiple of the 3 exposures)" in note


def test_sums_of_readings_are_called_so(opened, several):
    tab = opened("method=counts&white=1&overlays=jots", at=several)
    assert tab.locator("#method option").first.inner_text() == "sum of readings"
    assert "sum of readings · mean reading" in tab.locator("#rate").inner_text()
    tab.locator("#timeline-caption", has_text="Mean reading, a frame at each point").wait_for()
    tab.locator("#jots-note", has_text="0, not searched").wait_for()
    box = tab.locator("#image").bounding_box()
    tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    tab.locator("#readout", has_text="of 1920").wait_for()  # 32 frames of 4 jots, 15 photons each


def test_an_alignment_that_is_not_known_is_not_offered(opened, several):
    tab = opened("method=mle&white=1&align=1", at=several)
    assert tab.locator("#align").is_disabled()
    assert tab.locator("#align").get_attribute("aria-describedby") == "align-reason"
    assert "one jot" in tab.locator("#align-reason").inner_text()
    tab.keyboard.press("a")
    tab.locator("#toast", has_text="Align moving scene is unavailable: ").wait_for()
    assert "align=1 (expected 0, because" in tab.locator("#address-note").inner_text()


@pytest.mark.parametrize("width", [360, 860])
def test_the_controls_of_time_fit_beside_the_cycles(opened, bracket, width):
    tab = opened("method=mle", at=bracket, viewport={"width": width, "height": 740})
    outer = tab.locator(".time").bounding_box()
    for control in ("#play", "#range", "#window-number", "#window"):
        inner = tab.locator(control).bounding_box()
        assert outer["x"] <= inner["x"]
        assert inner["x"] + inner["width"] <= outer["x"] + outer["width"]
    play = tab.locator("#play").bounding_box()
    assert play["width"] == play["height"]
