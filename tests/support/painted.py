"""The page in Chromium: what its tests wait for."""

EVIL = "<img src=x onerror=\"document.title='owned'\">"
"""The title of the capture, which must never become HTML."""

RECORD = """
window.painted = [];
document.addEventListener("painted", (event) => window.painted.push(event.detail));
"""
"""A script that records what was painted."""


def final(tab, **expected):
    """Wait until a final image with some values has been painted, and return its header."""
    for _ in range(600):
        headers = [each for each in tab.evaluate("painted") if each["stage"] == "final"]
        if headers and all(headers[-1][name] == value for name, value in expected.items()):
            return headers[-1]
        tab.wait_for_timeout(20)
    raise AssertionError(f"no image with {expected}; the last one is {headers[-1:]}")
