"""Calibrations refuse bits whose sensor they would misread."""

import numpy as np
import pytest

import jotlight as jl

lazy = jl.dask.calibrate
CHECKERBOARD = 1 + np.indices((16, 16)).sum(axis=0) % 2
DARK = np.zeros((16, 16))


@pytest.mark.parametrize(
    ("options", "message"),
    [
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


@pytest.mark.slow
@pytest.mark.parametrize("calibrate", [jl.calibrate, lambda *a, **b: lazy(*a, **b).compute()])
@pytest.mark.parametrize("options", [{}, {"threshold": 2}])
def test_the_threshold_of_the_bits_is_taken(calibrate, options):
    sensor = jl.Sensor(frames=512, threshold=2, dark_counts=0.8)
    dark, flat = (sensor.expose(np.full((16, 16), value), rng=0) for value in (0.0, 2.0))
    found = calibrate(dark, flat, **options)
    assert found.threshold == 2
    assert np.median(found.dark_counts) == pytest.approx(0.8, rel=0.1)
    plain = jl.Bits(dark.packed, dark.width)
    assert calibrate(plain, flat, **options).threshold == 2
    assert jl.calibrate(plain).threshold == 1


@pytest.mark.parametrize("calibrate", [jl.calibrate, lazy])
@pytest.mark.parametrize("frames", [4096, np.int64(4096)])
def test_a_number_in_place_of_the_flat_capture_is_one_of_frames(calibrate, frames):
    with pytest.raises(TypeError, match=r"^flat: expected .*, got the number 4096; .*frames=4096$"):
        calibrate(np.full((16, 16), 3), frames)


@pytest.mark.parametrize("calibrate", [jl.calibrate, lazy])
def test_other_thresholds_are_refused(calibrate):
    dark, flat = (
        jl.Sensor(frames=64, threshold=q, dark_counts=0.1).expose(DARK, rng=0) for q in (2, 3)
    )
    with pytest.raises(ValueError, match=r"^dark: expected .* 1, got .* 2; state threshold=2 "):
        calibrate(dark, threshold=1)
    with pytest.raises(ValueError, match=r"^flat: .* 2, as those of dark, got bits of threshold 3"):
        calibrate(dark, flat)


def test_read_noise_is_not_counted_again_beside_measured_dark_counts():
    sensor = jl.Sensor(frames=64, dark_counts=0.1, read_noise=0.3)
    bits = sensor.expose(DARK, rng=0)
    calibration = jl.calibrate(jl.Bits(bits.packed, bits.width))
    for sensor_of in (
        lambda **changes: calibration.sensor(bits, **changes),
        lambda **changes: calibration.sensor(64, **{"read_noise": 0.3, **changes}),
        lambda **changes: calibration.applied_to(sensor, **changes),
    ):
        with pytest.raises(ValueError, match=r"^read_noise: expected 0 .*, got 0.3; state"):
            sensor_of()
        np.testing.assert_array_equal(sensor_of(read_noise=0).dark_counts, calibration.dark_counts)
        assert sensor_of(dark_counts=0.1).read_noise == 0.3
