"""The page in Chromium follows a live capture, and pauses."""

import os

import numpy as np
import pytest

from painted import final

pytestmark = pytest.mark.slow

FRAMES = np.random.default_rng(0).integers(0, 256, (2100, 64, 8), np.uint8)
IN_MEMORY = 2048

RECORD_STATUS = """
window.said = [];
const status = document.getElementById("status");
new MutationObserver(() => said.push(status.textContent)).observe(status, { childList: true });
"""


@pytest.fixture
def growing(tmp_path, started):
    """Return a function that adds frames to a file, and the server that follows the file."""
    from jotlight.view.live.options import LiveOptions, open_live

    path = tmp_path / "a.bin"

    def add(number):
        with path.open("ab") as file:
            file.write(FRAMES[:number].tobytes())

    add(100)
    live = open_live(path, LiveOptions(layout="64x64", history=1), {"frames": 1})
    yield add, started(live)
    live.close()


def badge(tab, text):
    tab.locator("#badge", has_text=text).wait_for()
    return tab.locator("#badge").inner_text()


def test_a_paused_page_does_not_say_that_it_is_live(opened, growing):
    add, running = growing
    tab = opened("window=16", at=running)
    assert badge(tab, "Live") == "Live · 100 frames · none dropped"
    tab.keyboard.press(" ")
    assert badge(tab, "Paused") == "Paused · 100 frames · none dropped"
    add(50)
    assert badge(tab, "150") == "Paused · 150 frames · none dropped"
    assert tab.locator("#range").inner_text() == "Frames 84 – 99"
    tab.keyboard.press(" ")
    assert badge(tab, "Live") == "Live · 150 frames · none dropped"
    assert final(tab, start=134)
    assert tab.locator("#range").inner_text() == "Frames 134 – 149"


def test_what_the_badge_says_is_spoken_but_not_its_numbers(opened, growing, tmp_path):
    add, running = growing
    tab = opened("window=16", at=running)
    said = tab.locator("#status")
    badge(tab, "Live")
    assert said.text_content() == "Live"
    add(50)
    badge(tab, "150")
    tab.wait_for_timeout(1000)
    assert said.text_content() == "Live"
    tab.evaluate(RECORD_STATUS)
    tab.keyboard.press(" ")
    badge(tab, "Paused")
    assert tab.evaluate("said[0]") == "Paused"
    os.truncate(tmp_path / "a.bin", 100)
    tab.wait_for_function("() => said.some((text) => text.includes('shorter'))")


def test_a_remark_needs_no_action(opened, growing):
    _, running = growing
    tab = opened("window=16", at=running)
    running._workshop.viewed.remark = "notes.txt: ignored"
    tab.locator("#toast", has_text="notes.txt: ignored").wait_for()
    assert not tab.locator("#dismiss").is_visible()
    tab.locator("#toast:empty").wait_for(state="attached")
    assert tab.locator("#remark").inner_text() == "notes.txt: ignored"


def test_paused_frames_that_leave_memory_keep_their_numbers(opened, growing):
    add, running = growing
    tab = opened("window=16", at=running)
    tab.keyboard.press(" ")
    badge(tab, "Paused")
    add(IN_MEMORY)
    badge(tab, str(100 + IN_MEMORY))
    tab.locator("#range", has_text="no longer in memory").wait_for()
    assert tab.locator("#range").inner_text() == "Frames 84 – 99, no longer in memory"


def test_a_phone_shows_the_name_of_a_live_capture(opened, growing):
    _, running = growing
    phone = {"viewport": {"width": 360, "height": 740}, "is_mobile": True}
    tab = opened("window=16", at=running, **phone)
    badge(tab, "Live")
    assert tab.locator(".title").evaluate("e => e.scrollWidth <= e.clientWidth")
