"""The processes in which methods are timed."""

import os

import pytest

from jotlight.experiments import timing


@pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="the system does not report the cores of a process"
)
def test_a_worker_on_one_core_has_one_core():
    before = os.sched_getaffinity(0)
    for cores, number in (("one core", 1), ("all cores", len(before))):
        with timing.worker(cores) as pool:
            assert len(pool.submit(os.sched_getaffinity, 0).result()) == number
    assert os.sched_getaffinity(0) == before
