"""The sensor of a calibration, and the images that it makes better."""

import numpy as np
import pytest

import jotlight as jl
from flat_captures import flat_scene
from jotlight.sensing.parameters.provenance import Provenance


@pytest.fixture(scope="module")
def calibration():
    rng = np.random.default_rng(12)
    ones, light, relative, dark = flat_scene(rng, 0.1, (32, 40))
    flat = jl.Bits.from_array(rng.random((800, 32, 40)) < 1 - np.exp(-dark - light * relative))
    ones[3, 4] = 4000
    return jl.calibrate(ones, flat, frames=4000, provenance={"dark": Provenance("npy", "dark.npy")})


def test_the_sensor_has_the_maps_and_a_gain_that_counts_ordinary_jots(calibration):
    sensor = calibration.sensor(16, max_intensity=3.0)
    assert sensor == jl.Sensor(
        frames=16,
        gain=16 * calibration.scale,
        dark_counts=calibration.dark_counts,
        efficiency=calibration.efficiency,
        mask=calibration.mask,
        max_intensity=3.0,
    )
    # Trained networks ask for 1 detection per frame at intensity 1.
    assert jl.pretrained(calibration.sensor(16)).reconstruct
    assert calibration.sensor(16, gain=5.0, dark_counts=0.25).gain == 5.0
    assert calibration.sensor(16, dark_counts=0.25).dark_counts == 0.25
    carried = jl.Sensor(frames=4, gain=2.0, threshold=1, oversampling=2)
    applied = calibration.applied_to(carried)
    assert applied.gain == pytest.approx(2 * calibration.scale)
    assert applied.oversampling == 2


@pytest.mark.filterwarnings("ignore:.*no valid bit")
def test_a_calibrated_image_is_nearer_to_the_scene(calibration):
    rng = np.random.default_rng(13)
    scene = np.full((32, 40), 0.4)
    camera = calibration.sensor(1024).replace(mask=None)
    seen = camera.expose(scene, rng).counts(1)
    errors = []
    for sensor in (jl.Sensor(frames=1024), calibration.sensor(1024)):
        good = ~calibration.mask
        errors.append(np.sqrt(np.mean((jl.mle(seen, sensor) - scene)[good] ** 2)))
    assert errors[1] < 0.9 * errors[0]


def test_the_shape_of_a_capture_is_checked(calibration):
    with pytest.raises(ValueError, match="it has 32 x 40 jots, and the capture has 40 x 32"):
        calibration.check_capture((40, 32))
