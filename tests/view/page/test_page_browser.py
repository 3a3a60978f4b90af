"""The page in Chromium shows what the library computes."""

import io
import json
import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.images.tone import Tone
from jotlight.view.viewed import Viewed
from painted import EVIL, RECORD, final

pytestmark = pytest.mark.slow

VISIBLE = """() => {
  const canvas = document.getElementById("image");
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  return [canvas.width, canvas.height, Array.from(data.filter((_, i) => i % 4 === 0))];
}"""


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
    assert tab.locator("#title").get_attribute("title") == EVIL  # a long one is cut
    assert tab.locator("#provenance").text_content().count(EVIL) == 3
    assert tab.locator("main img, aside img, header img").count() == 0


def test_the_exposure_of_a_shared_address_can_be_changed(opened):
    tab = opened("method=mle&window=16&white=0.5")
    tab.keyboard.press("e")
    tab.wait_for_function("() => !/white=0.5(&|$)/.test(location.hash)")
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
        tab.evaluate("document.getElementById('toast').textContent = ''")


def test_nothing_is_copied_without_a_server(opened):
    tab = opened("method=mle&window=16")
    tab.evaluate("() => { WebSocket.prototype.send = function () { this.close(); }; }")
    tab.keyboard.press("c")
    tab.locator("#stage-note", has_text="The connection is lost").wait_for()
    tab.keyboard.press("k")
    tab.locator("#toast", has_text="Not copied: the server does not answer").wait_for()


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


def test_the_address_is_no_way_to_inject(opened):
    tab = opened(f"method=mle&curve={EVIL}&start=1e9&window=-5&overlays=x,{EVIL}&white=abc")
    assert tab.title() != "owned"
    assert json.loads(json.dumps(tab.evaluate("painted")))[-1]["stage"] == "final"


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        ("window=0", "expected a whole number from 1"),
        ("window=-5", "expected a whole number from 1"),
        ("window=many", "expected a whole number from 1"),
        ("window=1e400", "expected a whole number from 1"),
        ("start=-1", "expected a whole number"),
        ("start=99999999999999999999", "expected a whole number"),
        ("method=nope", "expected a method that serves this capture"),
        ("compare=counts", "expected a method that serves this capture"),
        ("align=constructor", "expected 0 or 1"),
        ("curve=__proto__", "expected linear, gamma"),
        ("white=0", "expected a number from 1e-30 to 1e30"),
        ("white=1e-300", "expected a number from 1e-30 to 1e30"),
        ("white=Infinity", "expected a number from 1e-30 to 1e30"),
        ("overlays=jots,x", "expected some of jots,saturated,uncertainty"),
        ("follow=1", "unknown"),
        ("constructor=1", "unknown"),
        ("zoom", "unknown"),
    ],
)
def test_a_wrong_part_of_the_address_is_ignored_and_named(opened, part, expected):
    tab = opened(f"curve=log&{part}")
    header = final(tab)
    assert (header["start"], header["window"], header["tone"]["curve"]) == (0, 64, "log")
    note = tab.locator("#address-note")
    assert note.inner_text().startswith("Parts of the address are ignored: ")
    assert part[:20] in note.inner_text()
    assert expected in note.inner_text()
    tab.keyboard.press("c")  # the message stays until the state changes
    tab.locator("#address-note:empty").wait_for(state="attached")


def test_an_address_that_is_changed_by_hand_is_read_again(opened):
    tab = opened("method=mle&window=16")
    tab.evaluate("location.hash = 'method=mle&window=32&start=5'")
    assert final(tab, window=32)["start"] == 5
    assert tab.locator("#window-number").input_value() == "32"
    tab.evaluate("location.hash = 'method=mle&window=0'")
    assert final(tab, window=64)["start"] == 0
    assert "window=0 (expected" in tab.locator("#address-note").inner_text()


def test_an_address_that_is_changed_just_before_the_page_writes_its_own_is_read(opened):
    tab = opened("method=mle&window=16&white=1")
    tab.evaluate("""() => {
      location.hash = "method=mle&window=32&start=5";
      history.replaceState(null, "", "#method=mle&window=16&white=1");
    }""")
    assert final(tab, window=32)["start"] == 5
    tab.wait_for_function("() => location.hash.includes('window=32')")


def choose(tab, control, value):
    tab.locator(control).select_option(value)
    return tab.locator("#quality").input_value()


@pytest.fixture(scope="module")
def mosaic(server):
    from view_servers import serving

    sensor = jl.Sensor(frames=64, mosaic="RGGB")
    with serving(Viewed.from_data(sensor.expose(np.full((32, 32, 3), 0.5), rng=0))) as running:
        yield running


def test_the_network_of_a_mosaic_comes_back(opened, mosaic):
    tab = opened("method=mle", at=mosaic)
    assert choose(tab, "#method", "network") == "network-color"
    choose(tab, "#method", "counts")
    assert choose(tab, "#method", "network") == "network-color"


def test_the_last_quality_comes_back(opened):
    tab = opened("method=mle")
    assert choose(tab, "#method", "network") == "network-medium"
    choose(tab, "#quality", "network-small")
    choose(tab, "#method", "counts")
    assert choose(tab, "#method", "network") == "network-small"


def test_the_page_says_what_it_waits_for(opened, monkeypatch):
    from jotlight.view.pipeline import Pipeline

    refine, is_done = Pipeline.refine, threading.Event()

    def slow(*arguments):
        is_done.wait(60)
        return refine(*arguments)

    tab = opened("method=mle&window=16&white=1")
    monkeypatch.setattr(Pipeline, "refine", slow)
    choose(tab, "#method", "network")
    tab.locator("#stage-note", has_text="Waiting for network, medium").wait_for()
    tab.keyboard.press("Tab")
    tab.keyboard.press("a")
    tab.locator("#stage-note", has_text="network, medium of the aligned frames").wait_for()
    choose(tab, "#compare", "mle")
    text = "Waiting for network, medium minus maximum likelihood of the aligned frames"
    tab.locator("#stage-note", has_text=text).wait_for()
    is_done.set()
    tab.locator("#stage-note:empty").wait_for(state="attached")
    assert final(tab)["title"] == "network, medium"


def test_a_link_on_another_site_works(browser, server):
    link = server.address + "#method=mle&start=4&window=32"
    page = f"<a href='{link}'>the capture</a>".encode()

    class Elsewhere(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Elsewhere) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        tab = browser.new_page()
        tab.add_init_script(RECORD)
        tab.goto(f"http://localhost:{other.server_port}")
        tab.get_by_text("the capture").click()
        assert final(tab, window=32)["start"] == 4
        tab.close()
        other.shutdown()


def test_a_link_beyond_the_capture_shows_what_there_is(opened):
    tab = opened("method=mle&start=5000&window=64")
    assert final(tab)["start"] == 236
    assert tab.locator("#range").inner_text() == "Frames 236 – 299"
    text = "Frames 5000 to 5063 are not available. The image is that of frames 236 to 299."
    assert tab.locator("#toast").inner_text() == text
    changed = opened("method=mle&window=99999")
    assert final(changed)["window"] == 300
    text = "Frames 0 to 99998 are not available. The image is that of frames 0 to 299."
    assert changed.locator("#toast").inner_text() == text


def test_an_image_that_arrives_before_the_next_request_does_not_move_the_slider(opened):
    tab = opened("window=50&method=mle&white=0.8")
    tab.evaluate(
        """() => {
          const repaint = requestAnimationFrame;
          requestAnimationFrame = (draw) => setTimeout(() => repaint(draw), 200);
          const send = WebSocket.prototype.send;
          let steps = 0;
          WebSocket.prototype.send = function (text) {
            send.call(this, text);
            const isView = JSON.parse(text).type === "view";
            // The image is on its way when the user moves on.
            if (isView && steps++ < 3) {
              document.body.dispatchEvent(
                new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
            }
          };
        }"""
    )
    tab.keyboard.press("ArrowRight")
    final(tab, start=4)
    assert tab.locator("#toast").is_hidden()


def test_the_keyboard_stops_at_the_largest_exposure(opened):
    tab = opened("method=mle&window=16&white=1")
    for _ in range(60):
        tab.keyboard.press("e")
    tab.wait_for_function("() => location.hash.includes('white=0.0039')")
    assert float(re.search(r"white=([\d.e-]+)", tab.url)[1]) == pytest.approx(2**-8)
