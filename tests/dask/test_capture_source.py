import numpy as np

import jotlight as jl
from jotlight.dask.capture_source import CaptureSource


def test_a_process_opens_a_capture_again_that_was_recorded_again(tmp_path):
    path = tmp_path / "a.npy"
    for recorded in (False, True, False):
        jl.save(jl.Bits.from_array(np.full((4, 2, 9), recorded), jl.Sensor(frames=4)), path)
        bits = CaptureSource.of(str(path), {}).open()
        assert np.unique(np.asarray(bits)).tolist() == [recorded]


def test_a_process_keeps_a_capture_that_stays_the_same(tmp_path):
    path = tmp_path / "a.npy"
    jl.save(jl.Bits.from_array(np.zeros((4, 2, 9), bool), jl.Sensor(frames=4)), path)
    first, second = (CaptureSource.of(str(path), {"counts": False}).open() for _ in range(2))
    assert first is second
