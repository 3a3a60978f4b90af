import numpy as np

import jotlight as jl
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.runs.capture_source import CaptureSource


def test_a_process_opens_a_capture_again_that_was_recorded_again(tmp_path):
    path = tmp_path / "a.npy"
    for recorded in (False, True, False):
        jl.save(jl.Bits.from_array(np.full((4, 2, 9), recorded), jl.Sensor(frames=4)), path)
        bits = CaptureSource.of(str(path), ReadingOptions()).open()
        assert np.unique(np.asarray(bits)).tolist() == [recorded]


def test_a_process_keeps_a_capture_that_stays_the_same(tmp_path):
    path = tmp_path / "a.npy"
    jl.save(jl.Bits.from_array(np.zeros((4, 2, 9), bool), jl.Sensor(frames=4)), path)
    same = {"counts": False, "frames": slice(0, 2), "storage_options": None}
    sources = [CaptureSource.of(str(path), ReadingOptions(**same)) for _ in range(2)]
    assert hash(sources[0]) == hash(sources[1])
    first, second = (source.open() for source in sources)
    assert first is second
    other = CaptureSource.of(str(path), ReadingOptions(**{**same, "frames": slice(0, 3)}))
    assert len(other.open()) == 3
