"""Ctrl-C interrupts the engine's long calls."""

import signal
import subprocess
import sys
import time

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT"),
]

# Each call takes from many seconds to minutes, and little memory until it is interrupted.
PRELUDE = """
import signal
import numpy as np
import jotlight as jl

signal.signal(signal.SIGINT, signal.default_int_handler)
print("at work", flush=True)
"""
COUNTS = "np.full((4000, 4000), 50)"
SENSOR = (
    "jl.Sensor(frames=100, threshold=50, dark_counts=np.tile(np.float32([0.0, 1.0]), (4000, 2000)))"
)
CALLS = {
    "probability": (
        "jl.Sensor(8, kernel='cubic', threshold=50).probability(np.full((2000, 2000), 50.0))"
    ),
    "mle": f"jl.mle({COUNTS}, {SENSOR})",
    "noniterative": f"jl.noniterative({COUNTS}, {SENSOR}, denoiser=lambda z: z)",
    "network": (
        "jl.Network.initial(jl.Sensor(frames=50), taps=201).reconstruct(np.full((4000, 4000), 9))"
    ),
    "nlm": "jl.denoise.nlm(np.zeros((6000, 6000), np.float32))",
    "expose": "jl.Sensor(frames=200_000).expose(np.full((512, 512), 0.5))",
    "counts": "jl.Bits(np.broadcast_to(np.uint8(1), (10**7, 512, 64))).counts()",
}


@pytest.mark.parametrize("name", CALLS)
def test_ctrl_c_interrupts_a_long_call(name):
    with subprocess.Popen(
        [sys.executable, "-c", f"{PRELUDE}\n{CALLS[name]}\nprint('done')"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout.readline() == "at work\n"
            time.sleep(1)
            assert process.poll() is None
            process.send_signal(signal.SIGINT)
            out, error = process.communicate(timeout=10)
        finally:
            process.kill()
    assert "done" not in out
    assert "KeyboardInterrupt" in error
