import signal
import subprocess
import sys
import time

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")

# Either takes minutes, and little memory until it is interrupted.
PRELUDE = """
import signal
import numpy as np
import jotlight as jl

signal.signal(signal.SIGINT, signal.default_int_handler)
print("at work", flush=True)
"""
CALLS = {
    "expose": "jl.Sensor(frames=200_000).expose(np.full((512, 512), 0.5))",
    "counts": "jl.Bits(np.broadcast_to(np.uint8(1), (10**7, 512, 64))).counts()",
}


@pytest.mark.parametrize("name", CALLS)
def test_ctrl_c_ends_a_long_call(name):
    with subprocess.Popen(
        [sys.executable, "-c", f"{PRELUDE}\n{CALLS[name]}\nprint('done')"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout.readline() == "at work\n"
            time.sleep(0.4)
            assert process.poll() is None
            process.send_signal(signal.SIGINT)
            out, error = process.communicate(timeout=10)
        finally:
            process.kill()
    assert "done" not in out
    assert "KeyboardInterrupt" in error
