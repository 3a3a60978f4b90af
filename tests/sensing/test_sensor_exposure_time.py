"""The exposure time of a frame."""

import numpy as np

import jotlight as jl


def test_the_exposure_time_of_a_frame_is_kept_and_part_of_the_sensor(tmp_path):
    sensor = jl.Sensor(oversampling=2, frames=4, exposure_time=1e-5)
    assert sensor != sensor.replace(exposure_time=None)
    assert sensor.replace(frames=8).exposure_time == 1e-5
    assert repr(sensor).endswith("exposure_time=1e-05)")
    assert "exposure_time" not in jl.Sensor().scalars()
    bits = sensor.expose(np.full((8, 8), 0.5), rng=0)
    assert bits[1:3].sensor.exposure_time == 1e-5
    for name in ("bits.npy", "bits.npy.gz"):
        jl.save(bits, tmp_path / name)
        assert jl.open(tmp_path / name).sensor == sensor
