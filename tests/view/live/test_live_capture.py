"""The thread that reads a live capture."""

import threading

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.view.live.capture import LiveCapture
from jotlight.view.live.options import _wait_for_frame
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


def test_a_capture_that_ends_while_its_first_frame_is_awaited_is_viewed():
    class Late:
        title, problem, ended, stop = "a", None, False, threading.Event()
        arriving = iter([range(0), range(1)])

        @property
        def frames(self):
            self.ended = True  # the only frame arrives, and then the end
            return next(self.arriving)

    assert _wait_for_frame(Late()).ended
