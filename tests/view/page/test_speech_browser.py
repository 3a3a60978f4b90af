"""The page in Chromium tells screen readers what its keys have done, and why they do nothing."""

import re

import pytest

from painted import final

pytestmark = pytest.mark.slow


def test_the_keys_of_controls_say_their_new_state(opened):
    tab = opened("method=mle&window=16&white=1")
    for key, text in (
        ("s", "Saturated pixels: on"),
        ("c", "Curve: log"),
        ("v", "Theme: light"),
        ("5", "Method: closed"),
        ("e", "Exposure: +0.25 stops"),
        ("1", "Zoom: 100 %"),
    ):
        tab.keyboard.press(key)
        tab.locator("#status", has_text=text).wait_for(state="attached")
    tab.keyboard.press("q")
    tab.locator("#toast", has_text="Quality is unavailable: only a network").wait_for()
    assert tab.locator("#quality-reason").text_content() == "Only a network has qualities"


def test_an_overlay_that_is_shown_again_is_said_again(opened):
    tab = opened("method=mle&window=16&white=1")
    for text in (r"Saturated pixels: \d", "Saturated pixels: off", r"Saturated pixels: \d"):
        tab.keyboard.press("s")
        tab.locator("#status", has_text=re.compile(text)).wait_for(state="attached")


def test_a_difference_is_described_as_one(opened):
    tab = opened("method=mle&window=16&white=1")
    tab.keyboard.press("d")
    text = "maximum likelihood minus non-iterative, Gaussian, frames 0 to 15, root mean square 0."
    tab.locator("#status", has_text=text).wait_for(state="attached")
    assert text in tab.locator("#image").get_attribute("aria-label")
    tab.locator("#histogram[aria-label*='of the difference']").wait_for()
    assert "at -0.250 or below" in tab.locator("#histogram").get_attribute("aria-label")


def test_frames_that_follow_each_other_are_not_said(opened):
    tab = opened("method=mle&window=16&white=1")
    assert tab.locator("#start").get_attribute("aria-valuetext") == "frames 0 to 15 of 300"
    tab.keyboard.press(" ")
    tab.wait_for_function("() => document.getElementById('range').textContent !== 'Frames 0 – 15'")
    assert tab.locator("#start").get_attribute("aria-valuetext") == "the frames follow each other"
    tab.keyboard.press(" ")
    tab.locator("#start[aria-valuetext$='of 300']").wait_for()


def test_the_frames_beside_the_image_are_those_of_the_image(opened, monkeypatch):
    import threading

    from jotlight.view.pipeline import Pipeline

    count, is_done = Pipeline.count, threading.Event()

    def slow(*arguments):
        is_done.wait(60)
        return count(*arguments)

    tab = opened("method=mle&window=16&white=1")
    monkeypatch.setattr(Pipeline, "count", slow)
    # A request does not restart the time after which the page says that it waits.
    start = 0
    while start < 100 and not tab.locator("#stage-note").inner_text():
        tab.keyboard.press("ArrowRight")
        tab.wait_for_timeout(200)
        start += 1
    assert tab.locator("#stage-note").inner_text() == "Waiting for maximum likelihood"
    assert tab.locator("#range").inner_text() == "Frames 0 – 15"
    is_done.set()
    tab.locator("#range", has_text=f"Frames {start} – {start + 15}").wait_for()


def test_a_page_beyond_the_limit_says_so(browser, server, monkeypatch):
    monkeypatch.setattr("jotlight.view.app.MAX_PAGES", 0)
    tab = browser.new_page()
    tab.goto(server.address)
    tab.locator("#stage-note", has_text="which is the limit. Close one of them.").wait_for()
    monkeypatch.undo()
    tab.locator("#stage-note:empty").wait_for(state="attached")
    tab.close()


REFUSED = (
    "Object.defineProperty(window, 'localStorage', { get() { throw new Error('refused'); } });"
)


def test_the_page_works_where_the_browser_keeps_nothing(opened):
    tab = opened("method=mle&window=16", script=REFUSED)
    tab.keyboard.press("v")
    assert tab.locator("#theme").get_attribute("aria-label") == "Theme: light"


def test_the_keys_of_characters_can_be_switched_off(opened):
    tab = opened("method=mle&window=16&white=1")
    tab.keyboard.press("?")
    tab.get_by_label("Use the keys of single characters").uncheck()
    assert tab.locator("#save-png").get_attribute("aria-keyshortcuts") is None
    tab.keyboard.press("Escape")
    tab.keyboard.press("c")
    tab.keyboard.press("ArrowRight")
    tab.reload()
    final(tab)
    tab.keyboard.press("c")
    assert tab.locator("#curve").input_value() == "gamma"
    assert tab.locator("#start").get_attribute("aria-keyshortcuts") == "ArrowLeft ArrowRight"


CAPS_LOCK = """document.body.dispatchEvent(
  new KeyboardEvent("keydown", { key: "C", bubbles: true, modifierCapsLock: true }))"""


def test_problems_stay_and_focus_stays_without_a_clipboard(opened):
    script = "Object.defineProperty(navigator, 'clipboard', { value: undefined });"
    tab = opened("method=mle&window=16&white=1", script=script)
    tab.locator("#copy-link").focus()
    tab.keyboard.press("Enter")
    tab.locator("#toast", has_text="Copied").wait_for()
    assert tab.evaluate("document.activeElement.id") == "copy-link"
    assert not tab.locator("#dismiss").is_visible()
    tab.keyboard.press("q")
    tab.wait_for_timeout(4500)
    assert tab.locator("#toast").is_visible()
    tab.keyboard.press("Escape")
    assert not tab.locator("#toast").is_visible()
    tab.evaluate(CAPS_LOCK)
    assert tab.locator("#curve").input_value() == "log"
