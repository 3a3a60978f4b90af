"""Locks between the threads of each process."""

import os
import threading

import pytest

from jotlight.formats.files.locks import ProcessLock


def test_one_thread_at_a_time_holds_the_lock():
    lock, entered = ProcessLock(), threading.Event()

    def enter():
        with lock:
            entered.set()

    thread = threading.Thread(target=enter)
    with lock:
        thread.start()
        assert not entered.wait(0.05)
    assert entered.wait(60)
    thread.join()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_lock_is_free_in_a_fork_though_a_thread_of_the_parent_holds_it():
    lock, held, forked = ProcessLock(), threading.Event(), threading.Event()

    def hold():
        with lock:
            held.set()
            forked.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait()
    child = os.fork()
    if child == 0:
        acquired = threading.Event()

        def enter():
            with lock:
                acquired.set()

        threading.Thread(target=enter, daemon=True).start()
        os._exit(0 if acquired.wait(10) else 1)
    status = os.waitpid(child, 0)[1]
    forked.set()
    thread.join()
    assert status == 0
