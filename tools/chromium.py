"""Chromium, for the tests of pages, for screenshots, and for measurements of the viewer."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from typing import Any

NAMES = "chromium", "chromium-browser", "google-chrome"


def launch_options() -> dict[str, Any]:
    """Return the arguments with which Playwright launches the Chromium of the system.

    Raises
    ------
    FileNotFoundError
        When there is no Chromium on the path.
    """
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        raise FileNotFoundError(
            f"expected Chromium, found none of {', '.join(NAMES)} on the path; install chromium"
        )
    # Chromium refuses its sandbox to root, which containers run as.
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    return {"executable_path": program, "args": ["--no-sandbox"] if is_root else []}


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """Run Chromium, and yield it.

    Raises
    ------
    FileNotFoundError
        When there is no Chromium on the path.
    """
    from playwright.sync_api import sync_playwright

    options = launch_options()
    with sync_playwright() as driver:
        browser = driver.chromium.launch(**options)
        yield browser
        browser.close()
