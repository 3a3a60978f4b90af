"""The page in Chromium. Skipped without Playwright or without a Chromium."""

import io
import json
import re

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from chromium import chromium
from jotlight.images.tone import Tone
from jotlight.sensing.provenance import Provenance
from jotlight.view.viewed import Opening, Viewed

pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
from jotlight.view.serving import serving

pytestmark = pytest.mark.slow

WIDE = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}
PHOTO = jl.datasets.photograph("camera")[:200, :240]
EVIL = "<img src=x onerror=\"document.title='owned'\">"
RECORD = """
window.painted = [];
document.addEventListener("painted", (event) => window.painted.push(event.detail));
"""
VISIBLE = """() => {
  const canvas = document.getElementById("image");
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  return [canvas.width, canvas.height, Array.from(data.filter((_, i) => i % 4 === 0))];
}"""


@pytest.fixture(scope="module")
def server():
    scene = 0.5 * PHOTO
    scene[20, 30] = 80.0
    bits = jl.Sensor(frames=300, max_intensity=4.0, exposure_time=1e-4).expose(scene, rng=0)
    bits.provenance = Provenance("npy", EVIL, (EVIL,))
    viewed = Viewed(EVIL, bits, bits.sensor, True, Opening("a capture.npy"))
    with serving(viewed) as running:
        running.bits = bits
        yield running


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture
def opened(browser, server):
    """Open the page. At the end, no error was logged, and only this server was asked."""
    contexts, errors, requests = [], [], []

    def opened(state="", **options):
        context = browser.new_context(**({"viewport": WIDE} | options))
        context.grant_permissions(["clipboard-read", "clipboard-write"])
        contexts.append(context)
        tab = context.new_page()
        tab.add_init_script(RECORD)
        tab.on("console", lambda message: errors.append(message.text))
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("request", lambda request: requests.append(request.url))
        tab.goto(f"{server.address}#{state}")
        final(tab)
        return tab

    yield opened
    for context in contexts:
        context.close()
    assert errors == []
    assert all(
        url.startswith((f"http://127.0.0.1:{server.port}", "data:", "blob:")) for url in requests
    )


def final(tab, **expected):
    """Wait until a final image with some values has been painted, and return its header."""
    for _ in range(600):
        headers = [each for each in tab.evaluate("painted") if each["stage"] == "final"]
        if headers and all(headers[-1][name] == value for name, value in expected.items()):
            return headers[-1]
        tab.wait_for_timeout(20)
    raise AssertionError(f"no image with {expected}; the last one is {headers[-1:]}")


def test_the_visible_pixels_are_those_of_the_library(opened, server):
    tab = opened("window=50&start=7&method=mle&white=0.8&curve=gamma")
    tab.keyboard.press("1")  # one screen pixel for each pixel
    final(tab, start=7, window=50)
    width, height, values = tab.evaluate(VISIBLE)
    shown = np.array(values).reshape(height, width)
    expected = np.rint(255 * Tone("gamma", 0.8)(jl.mle(server.bits[7:57])))
    top, left = round((height - 200) / 2), round((width - 240) / 2)
    np.testing.assert_array_equal(shown[top : top + 200, left : left + 240], expected)


def test_enlarged_pixels_are_not_blurred(opened, server):
    tab = opened("window=50&method=mle&white=0.8")
    tab.keyboard.press("1")
    for _ in range(3):
        tab.keyboard.press("+")
    assert "800 %" in tab.locator("#zoom-value").inner_text()
    width, height, values = tab.evaluate(VISIBLE)
    shown = np.array(values).reshape(height, width)
    expected = np.rint(255 * Tone("gamma", 0.8)(jl.mle(server.bits[:50])))
    assert set(np.unique(shown)) <= {*np.unique(expected), *np.unique(shown[0, :1])}
    rows = np.flatnonzero(np.any(np.diff(shown, axis=0), axis=1))
    assert np.all(np.diff(rows) % 8 == 0)


def test_texts_of_a_capture_never_become_html(opened):
    tab = opened()
    assert tab.title() == f"{EVIL} – jotlight"
    assert tab.locator("#title").inner_text() == EVIL
    assert tab.locator("#provenance").text_content().count(EVIL) == 3
    assert tab.locator("main img, aside img, header img").count() == 0


def test_every_control_has_a_shortcut_and_a_label(opened):
    tab = opened("method=mle")
    controls = tab.locator("button:visible, select:visible, input:visible")
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
    ("d", "compare", "mle"),
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
    tab.wait_for_timeout(600)
    assert f"{name}={value}" in tab.url.split("#")[1]


def test_the_exposure_of_a_shared_address_can_be_changed(opened):
    tab = opened("method=mle&window=16&white=0.5")
    tab.keyboard.press("e")
    tab.wait_for_timeout(600)
    white = float(re.search(r"white=([\d.]+)", tab.url)[1])
    assert white == pytest.approx(0.5 * 2**-0.25, rel=1e-3)


def pressed(tab):
    return tab.locator("#auto").get_attribute("aria-pressed")


def test_auto_is_on_only_while_the_white_is_automatic(opened):
    assert pressed(opened("method=mle&window=16&white=0.5")) == "false"
    tab = opened("method=mle&window=16")
    assert pressed(tab) == "true"
    for key, expected in (("e", "false"), ("E", "true"), ("E", "false"), ("0", "true")):
        tab.keyboard.press(key)
        tab.wait_for_timeout(300)
        assert pressed(tab) == expected


def test_counts_have_an_exposure(opened, server):
    tab = opened("method=counts&window=16")
    white = final(tab)["tone"]["white"]
    assert white == pytest.approx(np.percentile(jl.mle(server.bits[:16]), 99.5), rel=0.01)
    tab.keyboard.press("e")
    assert final(tab, is_auto=False)["tone"]["white"] == pytest.approx(white * 2**-0.25, rel=1e-3)


def test_parts_of_the_controls_are_opened_and_closed_by_keys(opened):
    tab = opened("method=mle")
    for key, title in zip(
        "56789", ("Method", "Tone", "Overlays", "Sensor", "Provenance"), strict=True
    ):
        part = tab.locator("details", has=tab.locator("summary", has_text=title))
        before = part.get_attribute("open")
        tab.keyboard.press(key)
        assert part.get_attribute("open") != before


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
    assert f"window={window}" in tab.url.split("#")[1]
    assert tab.evaluate("document.activeElement.id") != "window-number"


def test_names_of_keys_are_those_that_screen_readers_know(opened):
    tab = opened("method=mle")
    names = tab.evaluate(
        "[...document.querySelectorAll('[aria-keyshortcuts]')]"
        ".map((e) => e.getAttribute('aria-keyshortcuts'))"
    )
    known = {"Space", "ArrowLeft", "ArrowRight", "Plus"}
    assert all(len(key) == 1 or key in known for name in names for key in name.split())
    assert not {"+", "←"} & {key for name in names for key in name.split()}


def test_all_buttons_fit_into_one_row_of_a_narrow_phone(opened):
    tab = opened("method=mle", viewport={"width": 360, "height": 740}, is_mobile=True)
    tops = tab.evaluate(
        "[...document.querySelectorAll('.actions button')]"
        ".map((e) => e.getBoundingClientRect().top)"
    )
    assert len(set(tops)) == 1


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


def test_overlays_are_drawn_over_the_image(opened):
    tab = opened("method=mle&window=300&white=1&overlays=saturated")
    tab.locator("#saturated-note", has_text="1").wait_for()
    colors = tab.evaluate("""() => {
      const canvas = document.getElementById("image");
      const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
      let number = 0;
      for (let i = 0; i < data.length; i += 4)
        if (data[i] === 255 && data[i + 1] === 176 && data[i + 2] === 0) number += 1;
      return number;
    }""")
    assert colors >= 9  # one pixel, enlarged


def test_a_link_shows_the_same_state_elsewhere(opened, browser):
    tab = opened("method=mle&window=16")
    tab.keyboard.press("c")
    tab.keyboard.press("l")
    tab.locator("#toast", has_text="Copied").wait_for()
    link = tab.evaluate("navigator.clipboard.readText()")
    other = browser.new_page()
    other.add_init_script(RECORD)
    other.goto(link)
    assert final(other, window=16)["tone"]["curve"] == "log"
    other.close()


def test_the_command_and_the_code_can_be_copied(opened):
    tab = opened("method=mle&window=16&start=4&white=0.5")
    for key, part in (
        ("k", "jotlight reconstruct 'a capture.npy'"),
        ("y", "import jotlight as jl"),
    ):
        tab.keyboard.press(key)
        tab.locator("#toast", has_text="Copied").wait_for()
        assert part in tab.evaluate("navigator.clipboard.readText()")
        tab.evaluate("document.getElementById('toast').hidden = true")


def test_an_image_can_be_saved(opened, server, tmp_path):
    tab = opened("method=mle&window=16&start=4&white=0.5&curve=linear")
    with tab.expect_download() as waiting:
        tab.keyboard.press("p")
    waiting.value.save_as(tmp_path / "a.png")
    saved = np.asarray(Image.open(io.BytesIO((tmp_path / "a.png").read_bytes())))
    expected = np.clip(jl.mle(server.bits[4:20]) / 0.5, 0, 1)
    np.testing.assert_allclose(saved / 65535, expected, atol=1e-5)
    assert waiting.value.suggested_filename.endswith("-4-20-mle.png")


def test_a_dragged_slider_shows_many_images_in_order(opened):
    tab = opened("method=mle&window=64&white=1")
    tab.evaluate("painted.length = 0")
    box = tab.locator("#start").bounding_box()
    tab.mouse.move(box["x"] + 4, box["y"] + 20)
    tab.mouse.down()
    tab.mouse.move(box["x"] + box["width"] - 4, box["y"] + 20, steps=40)
    tab.mouse.up()
    headers = final(tab, start=236) and tab.evaluate("painted")
    assert len({header["start"] for header in headers}) > 10
    assert [header["id"] for header in headers] == sorted(header["id"] for header in headers)


def test_phones_get_one_column_without_sideways_scrolling(opened):
    tab = opened("method=mle", viewport=PHONE, is_mobile=True, has_touch=True)
    assert tab.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    stage, panel = tab.locator("main").bounding_box(), tab.locator("aside").bounding_box()
    assert stage["y"] + stage["height"] <= panel["y"]
    assert stage["width"] == panel["width"] == PHONE["width"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_have_enough_contrast(opened, scheme):
    tab = opened("method=mle", color_scheme=scheme)
    for name in ("--ink", "--quiet", "--mark"):
        for ground in ("--ground", "--raised"):
            ratio = tab.evaluate(
                """([name, ground]) => {
                  const read = (name) => {
                    const probe = document.createElement("span");
                    probe.style.color = `var(${name})`;
                    document.body.append(probe);
                    const color = getComputedStyle(probe).color.match(/[\\d.]+/g).map(Number);
                    probe.remove();
                    return color;
                  };
                  const light = (color) => {
                    const [r, g, b] = color.map((v) => v / 255)
                      .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
                    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
                  };
                  const [a, b] = [light(read(name)), light(read(ground))].sort((x, y) => y - x);
                  return (a + 0.05) / (b + 0.05);
                }""",
                [name, ground],
            )
            assert ratio >= 4.5, (scheme, name, ground, ratio)


def test_the_theme_can_be_chosen(opened):
    tab = opened("method=mle", color_scheme="light")
    ground = "getComputedStyle(document.body).backgroundColor"
    light = tab.evaluate(ground)
    tab.keyboard.press("v")
    assert tab.evaluate(ground) == light
    tab.keyboard.press("v")
    assert tab.evaluate(ground) != light


def test_the_address_is_no_way_to_inject(opened):
    tab = opened(f"method=mle&curve={EVIL}&start=1e9&window=-5&overlays=x,{EVIL}&white=abc")
    assert tab.title() != "owned"
    assert json.loads(json.dumps(tab.evaluate("painted")))[-1]["stage"] == "final"
