"""The sensor of a capture is that of its file, changed by a calibration, and then by options."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.calibration.stated_sensor import stated_sensor
from jotlight.sensing.parameters.provenance import Provenance

STATED = jl.Sensor(frames=6, gain=2.0, max_intensity=3.0)
CAPTURE = {"frames": 8, "jots": (16, 24), "provenance": None}


@pytest.fixture(scope="module")
def calibration():
    dark = np.random.default_rng(0).binomial(1000, 0.01, (16, 24))
    return jl.calibrate(dark, frames=1000, threshold=2)


@pytest.mark.parametrize("changes", [{}, {"frames": 4}, {"gain": 5.0, "oversampling": 2}])
def test_options_replace_the_sensor_of_the_file(changes):
    assert stated_sensor(STATED, None, changes, **CAPTURE) == STATED.replace(**changes)
    assert stated_sensor(None, None, changes, **CAPTURE) == jl.Sensor(**{"frames": 8, **changes})


@pytest.mark.parametrize("changes", [{}, {"frames": 4}, {"gain": 5.0, "dark_counts": 0.5}])
def test_options_replace_the_calibration(calibration, changes):
    found = stated_sensor(STATED, calibration, changes, **CAPTURE)
    assert found == calibration.applied_to(STATED, **changes)
    assert found.max_intensity == 3.0
    found = stated_sensor(None, calibration, changes, **CAPTURE)
    assert found == calibration.sensor(**{"frames": 8, **changes})
    assert found.threshold == 2


@pytest.mark.parametrize("stated", [None, STATED])
def test_a_calibration_of_other_jots_is_refused(calibration, stated):
    other = {**CAPTURE, "jots": (16, 16)}
    with pytest.raises(ValueError, match=r"^calibration: it has 16 x 24 jots, .* has 16 x 16;"):
        stated_sensor(stated, calibration, {}, **other)
    assert stated_sensor(stated, None, {}, **other).frames in (6, 8)


def test_a_capture_in_another_orientation_is_refused():
    bits = jl.Bits.from_array(np.random.default_rng(0).random((200, 16, 16)) < 0.1)
    upright = Provenance("npy", "a.npy")
    dark = jl.Bits(bits.packed, bits.width, provenance=upright)
    calibration = jl.calibrate(dark)
    turned = {**CAPTURE, "jots": (16, 16), "provenance": upright.reoriented(1, None)}
    with pytest.raises(ValueError, match="open them in the same orientation"):
        stated_sensor(None, calibration, {}, **turned)
