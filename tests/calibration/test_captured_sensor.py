"""Calibrations refuse bits whose sensor they would misread."""

import numpy as np
import pytest

import jotlight as jl

CHECKERBOARD = 1 + np.indices((16, 16)).sum(axis=0) % 2
DARK = np.zeros((16, 16))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"threshold": 2}, r"threshold 1, got bits of threshold 2; state threshold=2"),
        ({"threshold": [1, 3] * 32}, "got several values of threshold; capture frames of one"),
        ({"threshold": CHECKERBOARD}, "got several values of threshold"),
        ({"gain": [1.0, 8.0] * 32}, "got several values of gain"),
        ({"read_noise": 0.3}, r"without read noise, got 0.3, .* \(--dark-counts\)"),
    ],
)
@pytest.mark.parametrize("name", ["dark", "flat"])
def test_bits_of_another_sensor_are_refused(name, options, message):
    plain = jl.Sensor(frames=64, dark_counts=0.1)
    captures = dict.fromkeys(("dark", "flat"), plain.expose(DARK, rng=0))
    captures[name] = plain.replace(gain=64.0).replace(**options).expose(DARK, rng=0)
    for calibrate in (jl.calibrate, jl.dask.calibrate):
        with pytest.raises(ValueError, match=f"^{name}: expected bits .*{message}"):
            calibrate(**captures)


def test_the_advised_threshold_is_taken():
    sensor = jl.Sensor(frames=512, threshold=2, dark_counts=0.8)
    found = jl.calibrate(sensor.expose(DARK, rng=0), threshold=2)
    assert np.median(found.dark_counts) == pytest.approx(0.8, rel=0.1)
