"""The page in Chromium. Skipped without Playwright or without a Chromium."""

import contextlib

import pytest

import jotlight as jl
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.view.viewed import Opening, Viewed
from painted import EVIL, RECORD, final

WIDE = {"width": 1280, "height": 800}
PHOTO = jl.datasets.photograph("camera")[:200, :240]


@pytest.fixture(scope="module")
def server():
    pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
    from view_servers import serving

    scene = 0.5 * PHOTO
    scene[20, 30] = 80.0
    bits = jl.Sensor(frames=300, max_intensity=4.0, exposure_time=1e-4).expose(scene, rng=0)
    bits.provenance = Provenance("npy", EVIL, (EVIL,))
    viewed = Viewed(EVIL, bits, bits.sensor, True, Opening("a capture.npy"))
    with serving(viewed) as running:
        running.bits = bits
        yield running


@pytest.fixture
def started():
    """Start the server of a capture, which runs until all pages are closed.

    A page that is still open would log that its server is gone.
    """
    pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
    from view_servers import serving

    with contextlib.ExitStack() as stack:
        yield lambda viewed: stack.enter_context(serving(viewed))


@pytest.fixture
def opened(browser, server, started):
    """Open the page. At the end, no error was logged, and only its server was asked."""
    contexts, errors, requests = [], [], []

    def opened(state="", at=server, script="", **options):
        context = browser.new_context(**({"viewport": WIDE} | options))
        context.grant_permissions(["clipboard-read", "clipboard-write"])
        contexts.append(context)
        tab = context.new_page()
        tab.add_init_script(RECORD + script)
        tab.on("console", lambda message: errors.append(message.text))
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("request", lambda request: requests.append((request.url, at.port)))
        tab.goto(f"{at.address}#{state}")
        final(tab)
        return tab

    yield opened
    for context in contexts:
        context.close()
    assert errors == []
    assert all(
        url.startswith((f"http://127.0.0.1:{port}", "data:", "blob:")) for url, port in requests
    )
