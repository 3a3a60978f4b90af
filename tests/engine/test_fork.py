"""A child process can use the engine, whatever other threads did at the moment of the fork."""

import os
import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork"),
]

# In each round, threads use objects that the engine prepares at their first use: a threshold, a
# network, and a pool of threads. Meanwhile the process forks, and the child uses the same objects.
# A child that waits for a lock, which no thread of its own holds, never ends. The alarm ends it.
PROGRAM = """
import dataclasses, os, signal, threading
import numpy as np
import jotlight as jl

image = np.full((40, 40), 0.5, np.float32)
counts = np.arange(1600, dtype=np.int32).reshape(40, 40) % 17
original = jl.pretrained(jl.Sensor(4), "large")
stop = threading.Event()
current = [original, 1]

def use(network, threshold):
    bits = jl.Sensor(4, threshold=threshold).expose(image, rng=0, threads=2)
    assert bits.counts(4, threads=2).shape == image.shape
    assert network.reconstruct(counts, threads=2).shape == counts.shape

def work():
    while not stop.is_set():
        use(*current)

use(*current)
threads = [threading.Thread(target=work) for _ in range(4)]
for thread in threads:
    thread.start()
failures = []
for round in range(80):
    layers = [dataclasses.replace(layer) for layer in original.layers]
    current[:] = jl.Network(layers, original.sensor), 1000 + round
    stop.wait(0.002 * (round % 10))
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        use(*current)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if status:
        failures.append((round, status))
        break
stop.set()
print(failures, flush=True)
os._exit(0)
"""


def test_a_child_does_not_wait_for_locks_of_the_parents_threads():
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM], capture_output=True, text=True
    )
    assert done.stdout == "[]\n", done.stderr


# SciPy's transforms in ADMM use a pool of threads, which a fork stops and starts again.
ADMM = """
import os, signal, threading
import numpy as np
import jotlight as jl

sensor = jl.Sensor(2, frames=4)
bits = sensor.expose(np.full((60, 60), 0.5, np.float32), rng=0)
stop = threading.Event()
errors = []

def use():
    return jl.admm_tv(bits, sensor, max_iter=3, threads=2)

def work():
    try:
        while not stop.is_set():
            use()
    except BaseException as error:
        errors.append(repr(error))

use()  # A fork while another thread imports a module would leave its import lock held forever.
threads = [threading.Thread(target=work) for _ in range(4)]
for thread in threads:
    thread.start()
for round in range(60):
    stop.wait(0.002 * (round % 10))
    child = os.fork()
    if child == 0:
        signal.alarm(30)
        use()
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if status:
        errors.append((round, status))
        break
stop.set()
print(errors, flush=True)
os._exit(0)
"""


def test_admm_survives_forks_in_the_parent_and_the_child():
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", ADMM], capture_output=True, text=True
    )
    assert done.stdout == "[]\n", done.stderr
