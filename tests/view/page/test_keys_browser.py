"""The page in Chromium is used by keyboard, and by screen readers."""

import pytest

from painted import final

pytestmark = pytest.mark.slow


def test_every_control_has_a_shortcut_and_a_label(opened):
    tab = opened("method=mle")
    controls = tab.locator("button:visible, select:visible, input:visible")
    assert controls.count() > 5
    for index in range(controls.count()):
        control = controls.nth(index)
        name = control.evaluate(
            "e => e.ariaLabel || e.textContent.trim() || e.labels?.[0]?.textContent"
        )
        assert name, control.evaluate("e => e.outerHTML")
        assert control.get_attribute("aria-keyshortcuts"), name


SHORTCUTS = [
    ("m", "method", "noniterative-gaussian"),
    ("ArrowRight", "start", 1),
    ("Shift+ArrowRight", "start", 16),
    ("End", "start", 284),
    ("[", "window", 8),
    ("]", "window", 32),
    ("c", "curve", "log"),
    ("d", "compare", "noniterative-gaussian"),
    ("j", "overlays", "jots"),
    ("s", "overlays", "saturated"),
    ("u", "overlays", "uncertainty"),
    ("a", "align", "1"),
]


@pytest.mark.parametrize(("key", "name", "value"), SHORTCUTS)
def test_shortcuts_change_the_state_and_the_address(opened, key, name, value):
    tab = opened("method=mle&window=16&white=1&curve=gamma" if name != "method" else "method=mle")
    if name == "method":
        tab.keyboard.press("m")
        tab.keyboard.press("m")
    else:
        tab.keyboard.press(key)
    tab.wait_for_function(f"() => location.hash.includes('{name}={value}')")


def test_parts_of_the_controls_are_opened_and_closed_by_keys(opened):
    tab = opened("method=mle")
    for key, title in zip(
        "56789", ("Method", "Tone", "Overlays", "Sensor", "Provenance"), strict=True
    ):
        part = tab.locator("details", has=tab.locator("summary", has_text=title))
        before = part.get_attribute("open")
        tab.keyboard.press(key)
        assert part.get_attribute("open") != before


def test_a_list_that_the_mouse_used_does_not_keep_the_keys(opened):
    tab = opened("method=mle&window=16&white=1")
    tab.locator("#method").click()
    assert tab.evaluate("document.activeElement.id") == "method"
    tab.locator("#method").select_option("counts")
    final(tab, title="fraction of ones")
    tab.keyboard.press("ArrowRight")
    assert final(tab, start=1)["title"] == "fraction of ones"
    # The mouse hits a button, or a part of one.
    for control, action in (("#auto", "Pause"), ("#zoom-value", "Play")):
        tab.locator(control).click()
        tab.keyboard.press(" ")
        assert tab.locator("#play").get_attribute("aria-label") == action


def test_escape_leaves_a_list(opened):
    tab = opened("method=mle&window=16&white=1")
    tab.locator("#curve").focus()
    tab.keyboard.press("ArrowDown")
    assert tab.evaluate("document.activeElement.id") == "curve"
    tab.keyboard.press("Escape")
    tab.keyboard.press("ArrowRight")
    assert final(tab, start=1)["tone"]["curve"] == "log"


def test_the_list_of_keys_begins_at_its_top(opened):
    tab = opened("method=mle", viewport={"width": 390, "height": 500})
    tab.keyboard.press("?")
    tab.locator("#shortcuts").wait_for()
    assert tab.locator("#shortcuts").evaluate(
        "e => [e.scrollTop, e.scrollHeight > e.clientHeight]"
    ) == [
        0,
        True,
    ]


def test_a_window_of_all_frames_is_not_played(opened):
    tab = opened("method=mle&window=300")
    assert tab.locator("#last-frame").inner_text() == "299"
    tab.keyboard.press(" ")
    tab.locator("#toast", has_text="Shorten it to play").wait_for()
    assert tab.locator("#play").get_attribute("aria-label") == "Play"
    assert tab.locator("#play").get_attribute("title") == "Play or pause (Space)"


KEY_PRESS = """([key, changes]) => document.dispatchEvent(
  new KeyboardEvent("keydown", { key, bubbles: true, ...changes }))"""


@pytest.mark.parametrize(
    ("key", "changes", "window"),
    [
        ("]", {"altKey": True, "ctrlKey": True, "modifierAltGraph": True}, 32),  # AltGr
        ("]", {"altKey": True}, 32),  # Option on a Mac
        ("]", {"ctrlKey": True}, 16),
        ("w", {"altKey": True}, 16),
    ],
)
def test_brackets_may_need_another_key(opened, key, changes, window):
    tab = opened("method=mle&window=16&white=1")
    tab.evaluate(KEY_PRESS.replace("document.", "document.body."), [key, changes])
    tab.wait_for_timeout(600)
    tab.wait_for_function(f"() => location.hash.includes('window={window}')")
    assert tab.evaluate("document.activeElement.id") != "window-number"


def test_names_of_keys_are_those_that_screen_readers_know(opened):
    tab = opened("method=mle")
    names = tab.evaluate(
        "[...document.querySelectorAll('[aria-keyshortcuts]')]"
        ".map((e) => e.getAttribute('aria-keyshortcuts'))"
    )
    known = {"Space", "ArrowLeft", "ArrowRight", "Plus", "Escape"}
    assert all(len(key) == 1 or key in known for name in names for key in name.split())
    assert not {"+", "←"} & {key for name in names for key in name.split()}


def test_the_page_can_be_used_by_keyboard_alone(opened):
    tab = opened("method=mle&window=16")
    tab.keyboard.press("?")
    assert tab.locator("#shortcuts").is_visible()
    assert tab.locator("#shortcuts").inner_text().count("\n") > 20
    tab.keyboard.press("Escape")
    tab.keyboard.press("i")
    tab.keyboard.press("ArrowDown")
    tab.locator("#readout dd").first.wait_for()
    assert (
        tab.locator("#readout").inner_text().replace("\n", " ").startswith("row, column 101, 120")
    )
    text = tab.locator("#readout").inner_text()
    for unit in ("intensity", "photons per frame", "photons per second"):
        assert unit in text


def test_a_screen_reader_says_the_values_that_the_keyboard_points_at(opened):
    tab = opened("method=mle&window=16")
    status = tab.locator("#status")
    tab.keyboard.press("i")
    for _ in range(3):
        tab.keyboard.press("ArrowDown")
    tab.locator("#status", has_text="row, column 103, 120; ones").wait_for(state="attached")
    said = status.text_content()
    box = tab.locator("#image").bounding_box()
    for step in range(10):
        tab.mouse.move(box["x"] + box["width"] / 2 + step, box["y"] + box["height"] / 2)
    row = "document.querySelector('#readout dd').textContent"
    tab.wait_for_function(f"() => !{row}.startsWith('103')")
    tab.wait_for_timeout(1000)
    assert status.text_content() == said
    assert tab.locator("#image").get_attribute("role") == "application"  # which arrow keys reach


def test_a_screen_reader_says_that_the_connection_is_lost(opened):
    tab = opened("method=mle&window=16")
    tab.evaluate("() => { WebSocket.prototype.send = function () { this.close(); }; }")
    tab.keyboard.press("c")
    tab.locator("#status", has_text="The connection is lost").wait_for(state="attached")
