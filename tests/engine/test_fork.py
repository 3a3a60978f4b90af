"""A child process can use the engine, whatever other threads did at the moment of the fork."""

import os
import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork"),
]

# Threads call `use` while the process forks, and each child calls `use` too. A child that waits
# for a lock, which no thread of its own holds, never ends. The alarm ends it.
PROGRAM = """
import dataclasses, os, signal, threading
import numpy as np
import jotlight as jl

{setup}

stop = threading.Event()
failures = []

def work():
    try:
        while not stop.is_set():
            use()
    except BaseException as error:
        failures.append(repr(error))

use()  # A fork while another thread imports a module would leave its import lock held forever.
threads = [threading.Thread(target=work, daemon=True) for _ in range(4)]
for thread in threads:
    thread.start()
for round in range({rounds}):
    renew(round)
    stop.wait(0.002 * (round % 10))
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        use()
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if status:
        failures.append((round, status))
        break
stop.set()
print(failures, flush=True)
os._exit(0)
"""

# In each round, the engine prepares a threshold, a network, and threads at their first use.
ENGINE = """
image = np.full((40, 40), 0.5, np.float32)
counts = np.arange(1600, dtype=np.int32).reshape(40, 40) % 17
original = jl.pretrained(jl.Sensor(oversampling=4), "medium")
current = [original, 1]

def renew(round):
    layers = [dataclasses.replace(layer) for layer in original.layers]
    network = jl.Network(layers, original.sensor, trials_range=original.trials_range)
    current[:] = network, 1000 + round

def use():
    network, threshold = current
    bits = jl.Sensor(oversampling=4, threshold=threshold).expose(image, rng=0, threads=2)
    assert bits.counts(4, threads=2).shape == image.shape
    sensor = jl.Sensor(frames=16)
    assert network.reconstruct(counts, sensor, threads=2).shape == counts.shape
"""

# Each call prepares another threshold, so the threads do little else.
THRESHOLDS = """
import itertools
from jotlight.estimators.inverse_response import intensity_from_probability

probability = np.full((4, 4), 0.1, np.float32)
thresholds = itertools.count(3000)

def renew(round):
    pass

def use():
    sensor = jl.Sensor(threshold=next(thresholds))
    assert intensity_from_probability(probability, sensor, 1).shape == probability.shape
"""

# SciPy's transforms in ADMM use a pool of threads, which a fork stops and starts again.
ADMM = """
sensor = jl.Sensor(oversampling=2, frames=4)
bits = sensor.expose(np.full((60, 60), 0.5, np.float32), rng=0)

def renew(round):
    pass

def use():
    jl.admm_tv(bits, sensor, max_iter=3, threads=2)
"""


@pytest.mark.parametrize(
    ("setup", "rounds"),
    [(ENGINE, 80), (THRESHOLDS, 10), (ADMM, 60)],
    ids=["engine", "thresholds", "ADMM"],
)
def test_calls_survive_forks_in_the_parent_and_the_child(setup, rounds):
    program = PROGRAM.format(setup=setup, rounds=rounds)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, timeout=300
    )
    assert done.stdout == "[]\n", done.stderr
