"""The website in Chromium: every page in both themes and at the width of a phone.

The folder that JOTLIGHT_SITE names holds the website; `nox -s gallery` builds it, and
`nox -s browser` runs these tests.
"""

import functools
import http.server
import os
import threading
from pathlib import Path

import pytest

axe = pytest.importorskip(
    "axe_playwright_python.sync_playwright", reason="no axe: pip install 'jotlight[browser]'"
)
pytestmark = pytest.mark.slow

SITE = Path(os.environ.get("JOTLIGHT_SITE", "missing")).resolve()
MIN_CONTRAST = 4.5
# Only pages of source code have names that begin with an underscore.
PAGES = sorted(
    path.relative_to(SITE).as_posix()
    for path in SITE.rglob("*.html")
    if not path.relative_to(SITE).parts[0].startswith("_")
)
DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 375, "height": 800}


class Handler(http.server.SimpleHTTPRequestHandler):
    """Serve files without a log."""

    def log_message(self, *arguments):
        pass


@pytest.fixture(scope="module")
def address():
    if not PAGES:
        pytest.skip("JOTLIGHT_SITE names no website: run nox -s gallery browser")
    handler = functools.partial(Handler, directory=str(SITE))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.fixture(params=["light", "dark"])
def tab(request, browser, address):
    """Return a tab in one theme, and check at the end what every page loaded and logged."""
    problems, requests = [], []
    context = browser.new_context(viewport=DESKTOP, color_scheme=request.param)
    tab = context.new_page()

    def log(message):
        if message.type in ("error", "warning"):
            problems.append(f"{tab.url}: {message.text}")

    tab.on("console", log)
    tab.on("pageerror", lambda error: problems.append(f"{tab.url}: {error}"))
    tab.on("response", lambda answer: requests.append((answer.status, answer.url)))
    yield tab
    context.close()
    assert problems == []
    assert [each for each in requests if each[0] >= 400] == []
    assert {url for _, url in requests if not url.startswith((address, "data:"))} == set()


def low_contrasts(tab):
    """Return the texts whose contrast axe computes to be below 4.5 : 1, whatever their size."""
    ratios = {size: {"expected": MIN_CONTRAST} for size in ("normal", "large")}
    checks = [{"id": "color-contrast", "options": {"contrastRatio": ratios}}]
    tab.evaluate(axe.Axe().axe_script)
    tab.evaluate("checks => axe.configure({ checks })", checks)
    options = {"runOnly": ["color-contrast"], "resultTypes": ["violations"]}
    found = tab.evaluate("options => axe.run(document, options)", options)
    return [
        f"contrast of {node['html'][:120]}: {node['any'][0]['data'].get('contrastRatio')}"
        for violation in found["violations"]
        for node in violation["nodes"]
    ]


def texts_off_the_phone(tab):
    """Return texts beyond the right edge of a phone that are not in a box that scrolls."""
    tab.set_viewport_size(PHONE)
    texts = tab.evaluate(
        """() => [...document.querySelectorAll("h1, h2, h3, p, li, dt, figcaption")].filter(
            element => element.getClientRects().length
                && element.getBoundingClientRect().right > window.innerWidth + 1
                && !element.closest("table, pre, .highlight, dialog, [class*=sidebar]")
        ).map(element => "off the phone: " + element.textContent.trim().slice(0, 60))"""
    )
    width = tab.evaluate("document.documentElement.scrollWidth")
    tab.set_viewport_size(DESKTOP)
    return texts + ([f"{width} pixels wide on a phone"] if width > PHONE["width"] else [])


def bad_images(tab):
    """Return the images that do not load, or that no text describes."""
    images = tab.evaluate(
        """async () => {
            // The thumbnails of the gallery only repeat the title below them.
            const images = [...document.images].filter(
                image => !image.closest(".sphx-glr-thumbcontainer"));
            for (const image of images) image.loading = "eager";
            await Promise.all(images.map(image => image.decode().catch(() => {})));
            return images.map(image => [image.src, image.naturalWidth, image.alt]);
        }"""
    )
    bad = [(source, width, text) for source, width, text in images if not (width and text)]
    return [f"image {source}: width {width}, text {text!r}" for source, width, text in bad]


def test_every_page_is_readable(tab, address):
    assert PAGES
    problems = []
    for page in PAGES:
        tab.goto(address + page)
        found = low_contrasts(tab) + bad_images(tab) + texts_off_the_phone(tab)
        problems += [f"{page}: {problem}" for problem in found]
    assert problems == []


def test_the_checks_find_problems(tab, address):
    tab.goto(address)
    tab.evaluate(
        """() => {
            const article = document.querySelector("article");
            article.innerHTML = '<p style="color:#888;background:#777">low</p>'
                + '<p style="width:900px">wide</p><img src="data:,x" alt="">'
                + '<p style="color:#888;background:#fff;font-size:2rem">large text, 3.5 : 1</p>';
        }"""
    )
    assert len(low_contrasts(tab)) == 2
    assert bad_images(tab)
    assert any("wide" in text for text in texts_off_the_phone(tab))


def test_the_theme_can_be_switched(tab, address):
    tab.goto(address)
    before = tab.evaluate("document.documentElement.dataset.theme")
    other = {"light": "dark", "dark": "light"}[before]
    tab.get_by_role("button", name="Color mode").first.click()
    tab.locator(f"button[data-mode={other}]").first.click()
    assert tab.evaluate("document.documentElement.dataset.theme") == other


@pytest.mark.parametrize("words", ["gain", "SwissSPAD2", "install", "train", "PSNR"])
def test_the_search_finds_words(tab, address, words):
    tab.goto(f"{address}search.html?q={words}")
    tab.locator("#search-results ul.search li").first.wait_for()
    assert tab.locator("#search-results ul.search li a").count() > 0
