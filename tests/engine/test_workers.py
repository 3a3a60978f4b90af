"""Any number of threads, concurrent calls, and forked and spawned workers lead to equal results."""

import multiprocessing
import sys
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import pytest

import jotlight as jl
from quantities import BITS, QUANTITIES, SENSOR, all_digests, digest

pytestmark = [
    pytest.mark.slow,
    # From Python 3.12 on, a fork of a process with threads leads to a warning.
    pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning"),
]
TIMEOUT = 120
needs_fork = pytest.mark.skipif(sys.platform != "linux", reason="needs a safe fork")


@pytest.fixture(scope="module")
def expected():
    """Return the digest of each quantity from one thread."""
    return {name: digest(name, threads=1) for name in QUANTITIES}


@pytest.mark.parametrize("name", QUANTITIES)
def test_one_two_and_eight_threads_lead_to_the_same_result(name, expected):
    assert [digest(name, threads) for threads in (2, 8)] == [expected[name]] * 2


def test_eight_concurrent_callers_get_the_same_results(expected):
    names = [name for name in QUANTITIES for _ in range(3)]
    with ThreadPoolExecutor(8) as callers:
        found = list(callers.map(digest, names, timeout=TIMEOUT))
    assert found == [expected[name] for name in names]


@pytest.mark.parametrize(
    "kind",
    [pytest.param("fork", marks=needs_fork), pytest.param("spawn", marks=pytest.mark.exhaustive)],
)
def test_workers_get_the_same_results(kind, expected):
    # The parent has idle threads of the engine, which a fork does not copy.
    assert all_digests() == expected
    context = multiprocessing.get_context(kind)
    with ProcessPoolExecutor(2, context) as workers:
        for found in workers.map(all_digests, range(2), timeout=TIMEOUT):
            assert found == expected
    assert all_digests() == expected


def reconstruct(connection):
    connection.send(float(jl.mle(BITS, SENSOR, threads=2).sum()))


@needs_fork
def test_a_fork_during_calls_of_other_threads_does_not_hang():
    expected = float(jl.mle(BITS, SENSOR, threads=2).sum())
    context, stop = multiprocessing.get_context("fork"), threading.Event()

    def call():
        while not stop.is_set():
            jl.mle(BITS, SENSOR, threads=2)

    callers = [threading.Thread(target=call) for _ in range(4)]
    for caller in callers:
        caller.start()
    try:
        for _ in range(40):
            receiver, sender = context.Pipe(duplex=False)
            child = context.Process(target=reconstruct, args=(sender,))
            child.start()
            answered = receiver.poll(TIMEOUT)
            if not answered:
                child.kill()
            assert answered
            assert receiver.recv() == expected
            child.join(TIMEOUT)
            assert child.exitcode == 0
    finally:
        stop.set()
        for caller in callers:
            caller.join()
