"""The thread that reads a live capture."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.view.live.capture import LiveCapture
from jotlight.view.live.ring import FrameLayout, FrameRing


def capture():
    ring = FrameRing(FrameLayout((1, 1), 8, 1, lambda raw: raw.reshape(-1, 1, 1)), max_bytes=4)
    ring.append(np.zeros((1, 1, 1), np.uint8))
    return LiveCapture("a", ring, jl.Sensor(frames=1), Provenance("raw", "a"))


@pytest.mark.parametrize("error", [ValueError("too long"), MemoryError("too long")])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_any_error_ends_the_capture_and_reaches_the_page(error):
    def fail(_):
        raise error

    live = capture()
    live.start(fail)
    live.close()
    facts = live.facts()
    assert facts["ended"]
    assert facts["problem"] == "too long"
