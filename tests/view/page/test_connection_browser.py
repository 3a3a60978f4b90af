"""The page in Chromium says what becomes of its server."""

import contextlib

import numpy as np
import pytest

import jotlight as jl
from jotlight.view.viewed import Viewed

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
