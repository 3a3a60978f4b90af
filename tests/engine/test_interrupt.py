"""Ctrl-C interrupts long calls within a second."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import jotlight as jl

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT"),
]

# A thread notes the CPU time at which a signal arrives: the main thread may be busy then.
# CPU time hardly depends on what else the machine computes.
PROGRAM = """
import json, os, queue, signal, sys, threading, time
import numpy as np
import scipy.interpolate, scipy.ndimage, scipy.optimize, skimage.restoration, skimage.filters
import jotlight as jl

counts = np.full((4000, 4000), 50, np.int32)
maps = jl.Sensor(frames=100, threshold=50, dark_counts=np.tile(np.float32([0, 1]), (4000, 2000)))
smooth = jl.Bits(np.broadcast_to(np.uint8(85), (9, 4000, 500)), 4000)
small = jl.Bits(np.random.default_rng(0).integers(0, 256, (64, 128, 16), np.uint8))
still = jl.align(small, model="none")
inbox, outbox = os.pipe()
os.set_blocking(outbox, False)
signal.set_wakeup_fd(outbox)
signal.signal(signal.SIGINT, signal.default_int_handler)
arrivals = queue.Queue()

def watch():
    while os.read(inbox, 1):
        arrivals.put((time.process_time(), time.monotonic()))

threading.Thread(target=watch, daemon=True).start()
for call in sys.stdin:
    print("at work", flush=True)
    try:
        eval(call)
    except KeyboardInterrupt:
        end = time.process_time(), time.monotonic()
        seconds = [a - b for a, b in zip(end, arrivals.get(), strict=True)]
        print(json.dumps(seconds), flush=True)
    else:
        print(json.dumps("the call ended before the signal"), flush=True)
"""
SENSOR = "jl.Sensor(frames=100)"
SMOOTH = "jl.Sensor(oversampling=2, frames=9, kernel='cubic')"
# Each call takes from many seconds to hours, and little memory until it is interrupted.
CALLS = {
    "rate": "jl.Sensor(oversampling=16, kernel='cubic').rate(np.full((2000, 1000), 50.0))",
    "probability": (
        "jl.Sensor(oversampling=8, kernel='cubic', threshold=50)"
        ".probability(np.full((2000, 2000), 50.0))"
    ),
    "expose": "jl.Sensor(frames=200_000).expose(np.full((512, 512), 0.5))",
    "expose, smooth": (
        "jl.Sensor(oversampling=8, frames=20, kernel='cubic', threshold=9)"
        ".expose(np.full((2000, 2000), 9.0))"
    ),
    "counts": "jl.Bits(np.broadcast_to(np.uint8(1), (10**7, 512, 64))).counts()",
    "counts, oversampled": ("jl.Bits(np.broadcast_to(np.uint8(1), (10**6, 4096, 512))).counts(4)"),
    "mle": "jl.mle(counts, maps)",
    "mle of jots": (
        "[jl.mle(jl.Bits(np.broadcast_to(np.uint8(85), (100, 4000, 500)), 4000), jl.Sensor("
        "oversampling=4, frames=100, "
        "dark_counts=np.tile(np.float32([0, 1]), (4000, 2000)))) for _ in range(99)]"
    ),
    "noniterative": "[jl.noniterative(counts, maps, denoiser=lambda z: z) for _ in range(99)]",
    "mle_iterative": f"jl.mle_iterative(smooth, {SMOOTH})",
    "admm_tv": f"[jl.admm_tv(smooth, {SMOOTH}) for _ in range(99)]",
    "admm_tv, q = 50": "jl.admm_tv(counts, jl.Sensor(frames=100, threshold=50))",
    "likelihood": (
        "jl.Likelihood(np.ones(10**7, np.int32), 2, threshold=65_535).proximal("
        "65_000.0, 1.0, max_light=1e5)"
    ),
    "automatic_weight": (
        "[jl.admm_tv(counts, jl.Sensor(frames=100, threshold=9), max_iter=1) for _ in range(99)]"
    ),
    "uncertainty": (
        "jl.uncertainty(np.arange(4_000_000, dtype=np.int32).reshape(2000, 2000), "
        "jl.Sensor(frames=4_000_000), method='mle')"
    ),
    "uncertainty, maps": "[jl.uncertainty(counts, maps, method='mle') for _ in range(99)]",
    "vst": "[jl.vst.inverse_anscombe(np.zeros((2, 2), np.float32), 2**31 - 1) for _ in range(99)]",
    "nlm": "jl.denoise.nlm(np.zeros((6000, 6000), np.float32))",
    "calibrate": (
        "jl.calibrate(np.tile(np.arange(20), (4000, 200)), "
        "np.tile(np.arange(200, 300), (4000, 40)), frames=1000)"
    ),
    "network, two-layer": (
        "jl.Network.initial(jl.Sensor(frames=50), taps=201).reconstruct(counts - 1)"
    ),
    "network, small": "[jl.pretrained({0}, 'small').reconstruct(counts, {0}) for _ in range(99)]",
    "network, medium": "[jl.pretrained({0}, 'medium').reconstruct(counts, {0}) for _ in range(99)]",
    "network, large": (
        "[jl.pretrained(jl.Sensor(oversampling=4), 'large').reconstruct(counts // 4) "
        "for _ in range(99)]"
    ),
    "network, untied": (
        "jl.Network.initial(jl.Sensor(oversampling=4), taps=201, tied=False).reconstruct("
        "jl.Bits(np.broadcast_to(np.uint8(85), (1, 16000, 2000)), 16000))"
    ),
    "align": (
        "jl.align(jl.Bits(np.random.default_rng(0).integers(0, 256, (200, 2000, 250), np.uint8)))"
    ),
    "align, small": "[jl.align(small) for _ in range(999)]",
    "merge": "[jl.merge(small, motion=still) for _ in range(999)]",
    "Gauss-Newton": "jl.train(jl.Network.initial({0}), np.full((9, 512, 512), 0.5), patch=512)",
    "Adam": (
        "jl.train(jl.pretrained(jl.Sensor(oversampling=4), 'two-layer'), "
        "np.full((2, 2000, 2000), 0.5), optimizer='adam', patch=2000, batch=9)"
    ),
}
MAX_SECONDS = 1
"""Maximum CPU time of all threads between the signal and the exception."""


class Child:
    """A process that makes one call after another, until one of them cannot be interrupted."""

    def __init__(self):
        self.process = None

    def interrupt(self, call):
        """Return the CPU time and the time in seconds between a signal and its exception."""
        if self.process is None:
            self.process = subprocess.Popen(
                [sys.executable, "-c", PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        process = self.process
        timer = threading.Timer(60, process.kill)  # a process that ignores the signal
        timer.start()
        try:
            process.stdin.write(f"{call}\n")
            process.stdin.flush()
            assert process.stdout.readline() == "at work\n"
            time.sleep(1)
            process.send_signal(signal.SIGINT)
            seconds = json.loads(process.stdout.readline())
            assert isinstance(seconds, list), seconds
            return seconds
        except BaseException:
            self.stop()
            raise
        finally:
            timer.cancel()

    def stop(self):
        """Kill the process, if there is one."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None


@pytest.fixture(scope="module")
def child():
    child = Child()
    yield child
    child.stop()


@pytest.mark.parametrize("name", CALLS)
def test_ctrl_c_interrupts_a_long_call(name, child):
    processor_seconds, _ = child.interrupt(CALLS[name].replace("{0}", SENSOR))
    assert processor_seconds < MAX_SECONDS


def long_call(threads=1, frames=2000):
    """Return the sum of bits that the engine draws, 2000 frames in about half a second."""
    image = np.full((256, 256), 0.5)
    return jl.Sensor(frames=frames).expose(image, rng=0, threads=threads).counts().sum()


@pytest.fixture
def on_alarm():
    """Return a function that sets the handler of an alarm, and starts the clock."""
    previous = signal.getsignal(signal.SIGALRM)

    def start(handler, *times):
        signal.signal(signal.SIGALRM, handler)
        signal.setitimer(signal.ITIMER_REAL, *times)

    yield start
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, previous)


def interrupt_later(seconds):
    """Send Ctrl-C after some time."""
    threading.Timer(seconds, os.kill, [os.getpid(), signal.SIGINT]).start()


def test_handlers_run_during_a_call_and_do_not_change_its_result(on_alarm):
    expected, calls = long_call(), []
    on_alarm(lambda *_: calls.append(1), 0.02, 0.02)
    assert long_call() == expected
    assert calls


@pytest.mark.parametrize("threads", [1, 2])
def test_a_call_in_a_handler_is_interrupted_alone(threads, on_alarm):
    expected, ends = long_call(threads), []

    def handler(*_):
        interrupt_later(0.1)
        try:
            long_call(threads, 20_000)
        except KeyboardInterrupt:
            ends.append("interrupted")

    on_alarm(handler, 0.02)
    assert long_call(threads) == expected
    assert ends == ["interrupted"]


@pytest.mark.parametrize("threads", [1, 2])
def test_ctrl_c_interrupts_a_call_after_a_handler_has_made_another(threads, on_alarm):
    long_call(threads, 1)
    starts = []

    def handler(*_):
        long_call(threads, 1)
        starts.append(time.process_time())
        interrupt_later(0.1)

    on_alarm(handler, 0.02)
    with pytest.raises(KeyboardInterrupt):
        long_call(threads, 20_000)
    assert time.process_time() - starts[0] < MAX_SECONDS


def test_ctrl_c_does_not_interrupt_calls_of_other_threads():
    expected, results = long_call(), []
    thread = threading.Thread(target=lambda: results.append(long_call()))
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    thread.join()
    assert results == [expected]
