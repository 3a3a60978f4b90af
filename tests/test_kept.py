"""A kept property is computed once per object, and a forked process can compute it."""

import dataclasses
import os
import signal
import threading

import pytest

from jotlight.kept import kept_property


@dataclasses.dataclass(frozen=True)
class Named:
    names: list[str]

    @kept_property
    def count(self) -> int:
        """The number of names."""
        self.names.append("computed")
        return len(self.names)


def test_a_value_is_kept_per_object():
    first, second = Named([]), Named(["another"])
    assert [first.count, first.count, second.count, first.count] == [1, 1, 2, 1]
    assert first.names == ["computed"]


def test_the_class_shows_the_property_and_its_docstring():
    assert isinstance(Named.count, kept_property)
    assert Named.count.__doc__ == "The number of names."


def test_an_error_is_not_kept():
    class Uncertain:
        calls = 0

        @kept_property
        def value(self):
            self.calls += 1
            if self.calls == 1:
                raise ValueError("no value yet")
            return self.calls

    uncertain = Uncertain()
    with pytest.raises(ValueError, match="no value yet"):
        _ = uncertain.value
    assert [uncertain.value, uncertain.value] == [2, 2]


def test_threads_that_compute_at_once_receive_the_same_value():
    both = threading.Barrier(2)

    class Slow:
        @kept_property
        def value(self):
            both.wait(60)
            return object()

    slow, received = Slow(), []
    threads = [threading.Thread(target=lambda: received.append(slow.value)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert received[0] is received[1] is slow.value


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_child_does_not_wait_for_a_thread_of_its_parent():
    begun, end = threading.Event(), threading.Event()

    class Slow:
        @kept_property
        def value(self):
            if threading.current_thread() is not threading.main_thread():
                begun.set()
                end.wait(60)
            return 3

    thread = threading.Thread(target=lambda: Slow().value)
    thread.start()
    begun.wait(60)
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(20)  # it ends a child that waits forever
        os._exit(Slow().value)
    _, status = os.waitpid(child, 0)
    end.set()
    thread.join()
    assert os.waitstatus_to_exitcode(status) == 3
