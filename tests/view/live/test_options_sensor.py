"""Live captures: their sensor."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.view.live.options import LiveOptions, open_live


def test_the_sensor_of_a_stream_is_assumed_and_the_note_says_so(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(4 * 6 * 2))
    live = open_live(path, LiveOptions(layout="6x13"), {"frames": 1})
    live.close()
    assert live.sensor_note == "the bits do not state their sensor; assumed: Sensor()"
    assert not live.is_range_known


def test_a_folder_has_the_sensor_that_its_files_state(tmp_path):
    sensor = jl.Sensor(frames=16, threshold=2, oversampling=2)
    jl.save(sensor.expose(np.full((4, 4), 0.5), rng=0), tmp_path / "f1.npy")
    live = open_live(tmp_path, LiveOptions(), {"frames": 1, "efficiency": 0.5})
    live.close()
    assert live.sensor(16) == sensor.replace(efficiency=0.5)
    assert (live.shape, live.sensor_note, live.is_range_known) == ((4, 4), "", True)


@pytest.mark.parametrize("changes", [{"gain": [1.0, 8.0] * 4}, {"read_noise": 0.2}])
def test_a_folder_of_frames_that_differ_is_refused(tmp_path, changes):
    sensor = jl.Sensor(frames=8, **changes)
    jl.save(sensor.expose(np.full((4, 4), 0.5), rng=0), tmp_path / "f1.npy")
    with pytest.raises(ValueError, match="of one exposure and one threshold, without read noise"):
        open_live(tmp_path, LiveOptions(), {"frames": 1})
