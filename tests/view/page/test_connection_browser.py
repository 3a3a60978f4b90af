"""The page in Chromium says what becomes of its server."""

import contextlib

import numpy as np
import pytest

import jotlight as jl
from jotlight.view.viewed import Viewed
from painted import final

pytestmark = pytest.mark.slow

VIEWED = Viewed.from_data(jl.Bits.from_array(np.eye(8, dtype=bool)[None]))
OUTDATED = "This address is no longer valid, because the viewer was started again."


@contextlib.contextmanager
def lost_page(browser):
    """Yield a page and the server that it has lost."""
    from view_servers import serving

    tab = browser.new_page()
    try:
        with serving(VIEWED) as first:
            tab.goto(first.address)
            tab.locator("#stage-note:empty").wait_for(state="attached")
        tab.locator("#stage-note", has_text="The connection is lost").wait_for()
        yield tab, first
    finally:
        tab.close()


def test_a_page_of_an_earlier_viewer_says_which_address_to_open(browser, server):
    from view_servers import serving

    with lost_page(browser) as (tab, first), serving(VIEWED, port=first.port):
        tab.locator("#stage-note", has_text=OUTDATED).wait_for()
        assert "Open the address that the terminal shows" in tab.inner_text("#stage-note")


def test_a_page_of_the_same_viewer_connects_again(browser, server):
    from view_servers import serving

    with lost_page(browser) as (tab, first), serving(VIEWED, port=first.port, token=first.token):
        tab.locator("#stage-note:empty").wait_for(state="attached")


SILENT = "window.WebSocket = class {};"


def test_a_page_without_an_answer_ignores_keys_and_says_so(browser, server):
    tab, errors = browser.new_page(), []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.add_init_script(SILENT)
    tab.goto(server.address)
    for key in (" ", "ArrowRight", "End", "m", "]", "q", "l"):
        tab.keyboard.press(key)
    tab.locator("#copy-link").click()
    tab.locator("#toast", has_text="Not copied: the server does not answer").wait_for()
    for part in ("#play", "#method"):
        assert tab.locator(part).evaluate("e => e.closest('[inert]') !== null")
    tab.close()
    assert errors == []


MOVES_WHEN_IT_OPENS = """
const Native = WebSocket;
window.WebSocket = class extends Native {
  constructor(address) {
    super(address);
    window.socket = this;
    this.addEventListener("open", () => {
      const repaint = requestAnimationFrame;
      const press = new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true });
      window.requestAnimationFrame = (draw) => draw();
      document.body.dispatchEvent(press);
      window.requestAnimationFrame = repaint;
    });
  }
  set onmessage(read) {
    super.onmessage = (event) => setTimeout(() => read(event), 300);
  }
};
"""
"""A slow connection, on which the user moves on before the first message arrives."""


def test_a_page_that_is_used_before_the_server_has_answered_shows_all_later_images(opened):
    tab = opened("method=mle&window=16&white=1", script=MOVES_WHEN_IT_OPENS)
    for start in range(1, 9):
        tab.keyboard.press("ArrowRight")
        final(tab, start=start)
    tab.evaluate("window.socket.close()")
    final(tab, start=9)
    tab.keyboard.press("Home")
    final(tab, start=0)
