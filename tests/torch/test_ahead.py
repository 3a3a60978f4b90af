"""Batches that are drawn ahead."""

import threading
from typing import ClassVar

import numpy as np
import pytest

pytest.importorskip("torch")

from jotlight import Network, Sensor
from jotlight.torch.ahead import AheadLoader
from jotlight.torch.patches import PatchLoader
from jotlight.training import SyntheticPatches


class Watched(PatchLoader):
    """A loader that records its steps and threads."""

    def batch(self, step, shard, threads):
        self.log.append((step, threading.current_thread().name))
        if step == 3:
            raise ValueError("step 3 is damaged")
        return super().batch(step, shard, threads)

    log: ClassVar[list] = []


def loader(kind=PatchLoader):
    network = Network.conditional("small", rng=0)
    return kind(SyntheticPatches(), network, Sensor(), 0, batch_size=2, side=32)


def test_batches_are_those_of_the_loader_in_any_order():
    with AheadLoader(loader(), slice(None), last=5) as ahead:
        for step in (0, 1, 4, 2, 3, 5):
            expected = loader().batch(step, slice(None), 1)
            found = ahead.batch(step, 1)
            np.testing.assert_array_equal(found.data, expected.data)
            np.testing.assert_array_equal(found.truth, expected.truth)


def test_the_next_batch_is_drawn_in_a_thread_but_none_after_the_last():
    Watched.log = []
    with AheadLoader(loader(Watched), slice(None), last=2) as ahead:
        for step in range(3):
            ahead.batch(step, 1)
    steps, names = zip(*Watched.log, strict=True)
    assert steps == (0, 1, 2)
    assert names[0] == "MainThread"
    assert all(name.startswith("jotlight-batches") for name in names[1:])


def test_an_error_reaches_the_step_that_needs_the_batch():
    with AheadLoader(loader(Watched), slice(None), last=9) as ahead:
        ahead.batch(2, 1)
        with pytest.raises(ValueError, match="step 3 is damaged"):
            ahead.batch(3, 1)
