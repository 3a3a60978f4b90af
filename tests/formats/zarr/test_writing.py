"""Writing of zarr folders."""

import os
import signal
import sys
import time

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.zarr import writing
from jotlight.sensing.bits.bits import Bits

zarr = pytest.importorskip("zarr")


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal")
@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
def test_an_interrupted_write_leaves_nothing_even_if_zarr_is_slow(tmp_path, monkeypatch, number):
    import zarr.storage._local as local

    calls = []

    def slow_put(*arguments, put=local._put, **options):
        calls.append(arguments[0])
        if len(calls) == number:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.3)
        return put(*arguments, **options)

    monkeypatch.setattr(local, "_put", slow_put)
    monkeypatch.setattr(writing, "_SHARD_CHUNKS", 1)
    frames = np.random.default_rng(0).integers(0, 2, (300, 256, 1024), np.uint8)
    bits = Bits.from_array(frames)
    with pytest.raises(KeyboardInterrupt):
        jl.save(bits, tmp_path / "out.zarr")
    assert list(tmp_path.iterdir()) == []
    time.sleep(0.4)
    assert list(tmp_path.iterdir()) == []
    assert len(calls) == number
