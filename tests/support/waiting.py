"""Waiting for what other threads do."""

import time


def wait_for(condition, seconds=60.0):
    """Return when a condition holds, and fail if it does not within some seconds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing arrived"
        time.sleep(0.002)
