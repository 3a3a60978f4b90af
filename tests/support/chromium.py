"""Chromium, for the tests of pages."""

import contextlib
import os
import shutil

import pytest

NAMES = "chromium", "chromium-browser", "google-chrome"


@contextlib.contextmanager
def chromium():
    """Run the Chromium of the system, and yield it; skip the test if there is none."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="no Playwright: pip install 'jotlight[browser]'"
    )
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the path")
    # Chromium refuses its sandbox to root, which containers run as.
    arguments = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=arguments)
        yield browser
        browser.close()
