"""The controls of the page in Chromium do what they say."""

import itertools

import pytest

from painted import final

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("at", [1, 8, 64, 200])
def test_each_arrow_key_changes_the_length_of_the_window(opened, at):
    tab = opened(f"method=mle&window={at}&white=1")
    tab.locator("#window").focus()
    lengths = [at]
    for _ in range(5):
        tab.keyboard.press("ArrowRight")
        lengths.append(int(tab.locator("#window-number").input_value()))
    assert all(after > before for before, after in itertools.pairwise(lengths))
    for _ in range(6):
        tab.keyboard.press("ArrowLeft")
    assert int(tab.locator("#window-number").input_value()) < max(2, at)


def test_the_slider_of_the_window_reaches_both_ends(opened):
    tab = opened("method=mle&window=20&white=1")
    tab.locator("#window").focus()
    for key, window in (("End", 300), ("Home", 1)):
        tab.keyboard.press(key)
        assert final(tab, window=window)


@pytest.mark.parametrize(
    ("typed", "window"), [("", 20), ("0", 20), ("-5", 1), ("9999", 300), ("7.5", 8)]
)
def test_a_window_that_does_not_exist_is_named(opened, typed, window):
    tab = opened("method=mle&window=20&white=1")
    tab.locator("#window-number").fill(typed)
    tab.keyboard.press("Enter")
    assert tab.locator("#window-number").input_value() == str(window)
    expected = "" if typed == "7.5" else "A window has 1 to 300 frames."
    assert tab.locator("#toast").text_content().strip() == expected


def test_play_stops_when_the_window_holds_all_frames(opened):
    tab = opened("method=mle&window=200&white=1")
    tab.keyboard.press(" ")
    assert tab.locator("#play").get_attribute("aria-label") == "Pause"
    tab.keyboard.press("]")
    tab.locator("#play[aria-label=Play]").wait_for()
    tab.keyboard.press("[")
    tab.keyboard.press(" ")
    assert tab.locator("#play").get_attribute("aria-label") == "Pause"


def test_play_stops_when_the_connection_is_lost(opened):
    tab = opened("method=mle&window=16&white=1")
    tab.keyboard.press(" ")
    tab.evaluate("() => { WebSocket.prototype.send = function () { this.close(); }; }")
    tab.locator("#play[aria-label=Play]").wait_for()
