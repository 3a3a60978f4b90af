import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.planning.bracketing import snr_bound
from jotlight.sensing.likelihood.reference import saturation_intensity
from jotlight.sensing.parameters.response import detection_probability

SENSORS = [
    {},
    {"threshold": 2, "dark_counts": 0.05},
    {"oversampling": 2, "efficiency": 0.4},
    {"threshold": 5, "gain": 3.0},
]


@pytest.mark.parametrize("options", SENSORS, ids=str)
@pytest.mark.parametrize("frames", [1, 6, 50])
def test_bias_and_error_agree_with_simulated_captures(options, frames):
    light = 0.7 * options.get("threshold", 1)
    base = jl.Sensor(**options)
    expected = jl.plan(base, light, frames=[frames])
    sensor = base.replace(frames=frames)
    sensor = sensor.replace(max_intensity=saturation_intensity(sensor))
    unit = sensor.gain / sensor.trials
    bits = sensor.expose(np.full((150, 150), light / unit), rng=frames)
    error = jl.mle(bits, sensor).astype(np.float64) * unit - light
    # 24 comparisons at 4.5 standard errors: one run in 6000 fails by chance.
    spread = error.std() / 150
    assert abs(error.mean() - expected.bias[0, 0]) < 4.5 * spread
    spread = (error**2).std() / 150
    assert abs((error**2).mean() - expected.rmse[0, 0] ** 2) < 4.5 * spread


def test_the_quality_of_a_single_bit_has_its_closed_form():
    light = np.array([0.3])
    expected = jl.plan(jl.Sensor(), 0.3, frames=[1])
    probability, one = -np.expm1(-light), np.log(2)  # half a count from saturation
    np.testing.assert_allclose(expected.bias[0], probability * one - light)
    square = probability * (one - light) ** 2 + (1 - probability) * light**2
    np.testing.assert_allclose(expected.rmse[0] ** 2, square)
    assert expected.psnr[0] == pytest.approx(10 * np.log10(light[0] ** 2 / square[0]))


def test_the_cramer_rao_bound_has_its_closed_form_and_is_reached_with_many_bits():
    expected = jl.plan(jl.Sensor(), (0.1, 2.0), frames=[1, 10_000])
    closed = np.sqrt(np.expm1(expected.light)[None] / np.array([[1], [10_000]]))
    np.testing.assert_allclose(expected.cramer_rao_bound, closed, rtol=1e-9)
    np.testing.assert_allclose(expected.rmse[1], expected.cramer_rao_bound[1], rtol=2e-3)
    np.testing.assert_allclose(expected.snr[1], expected.snr_bound[1], atol=0.02)


def test_the_optimal_light_agrees_with_theory():
    # s² / (exp(s) - 1) is highest at s = 2 (1 - exp(-s)).
    assert jl.plan(jl.Sensor(), 1.0, frames=[1]).optimal_light == pytest.approx(1.5936, rel=2e-3)
    assert jl.plan(jl.Sensor(efficiency=0.5), 1.0, frames=[1]).optimal_light == pytest.approx(
        3.187, rel=2e-3
    )


def test_the_psnr_is_that_of_uniformly_distributed_light():
    expected = jl.plan(jl.Sensor(), (0.05, 2.0), frames=[40])
    levels = np.linspace(0.05, 2.0, 2001)
    counts = np.arange(41)
    estimates = np.minimum(-np.log(np.maximum(1 - counts / 40, 1e-300)), np.log(80))
    from scipy.stats import binom

    pmf = binom.pmf(counts, 40, detection_probability(1, levels)[:, None])
    square = (pmf * (estimates - levels[:, None]) ** 2).sum(1)
    mean = (square[1:] + square[:-1]).mean() / 2
    assert expected.psnr[0] == pytest.approx(10 * np.log10(4 / mean), abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("options", SENSORS, ids=str)
def test_more_frames_are_better_and_required_frames_is_the_minimum(options):
    light = (0.05, 1.5 * options.get("threshold", 1))
    sensor = jl.Sensor(**options)
    expected = jl.plan(sensor, light, target_psnr=25.0)
    assert (np.diff(expected.psnr[expected.frames >= 8]) > 0).all()
    assert (np.diff(expected.saturation_light) > 0).all()
    near = jl.plan(sensor, light, frames=[expected.required_frames - 1, expected.required_frames])
    assert near.psnr[0] < 25 <= near.psnr[1]


def test_at_the_saturation_light_one_pixel_in_a_hundred_has_only_ones():
    sensor = jl.Sensor(threshold=2, dark_counts=0.1, efficiency=0.6, oversampling=2)
    expected = jl.plan(sensor, 1.0, frames=[1, 9, 10**6])
    bits = 4 * expected.frames
    probabilities = detection_probability(2, 0.6 * expected.saturation_light + 0.1)
    np.testing.assert_allclose(probabilities[:2] ** bits[:2], 0.01, rtol=1e-9)
    np.testing.assert_allclose(probabilities[2] ** bits[2], 0.01, rtol=1e-6)


@pytest.mark.parametrize("readings", [{}, {"read_noise": 0.3}, {"bit_depth": 2, "read_noise": 0.3}])
def test_readings_that_dark_counts_saturate_have_a_plan(readings):
    sensor = jl.Sensor(dark_counts=20.0, **readings)
    expected = jl.plan(sensor, (1.0, 1e4), frames=[10, 10**6])
    assert expected.saturation_light.tolist() == [0, 0]
    assert np.isfinite(expected.rmse).all()


def test_readings_that_are_nearly_certain_have_a_plan():
    sensor = jl.Sensor(dark_counts=5.0, read_noise=0.3)
    expected = jl.plan(sensor, (1.0, 1e4), frames=[10**6])  # no warning
    assert np.isfinite(expected.rmse).all()


@pytest.mark.parametrize("readings", [{"threshold": 2}, {"bit_depth": 2}])
@pytest.mark.parametrize("strongest", [0.5, 1.0])
def test_the_most_responsive_jot_does_not_change_a_plan(readings, strongest):
    efficiency = [[0.25, 0.25, strongest, 0.1]]
    dark_counts, mask = [[0.02, 0.01, 0.03, 9.0]], [[False, False, False, True]]
    maps = {"efficiency": efficiency, "dark_counts": dark_counts, "mask": mask}
    found, expected = (
        jl.plan(sensor, (0.1, 2.0), frames=[8], max_intensity=1.5, target_psnr=10)
        for sensor in (
            jl.Sensor(**readings, **maps, gain=4.0),
            jl.Sensor(**readings, dark_counts=np.float32(0.02)),
        )
    )
    for name in ("bias", "rmse", "cramer_rao_bound", "saturation_light", "required_frames"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-6)


def test_estimates_are_clipped_to_the_maximum_intensity():
    expected = jl.plan(
        jl.Sensor(gain=0.5), (0.1, 3.0), frames=[4096], target_psnr=30.0, max_intensity=2.0
    )
    assert expected.required_frames is None
    assert expected.bias[0, -1] == pytest.approx(1.0 - 3.0, abs=1e-9)


@pytest.mark.parametrize(
    ("light", "options", "message"),
    [
        (0.0, {}, "above 0"),
        ((2.0, 1.0), {}, "the minimum and the maximum"),
        (1.0, {"frames": []}, r"frames: expected a list such as \[16, 256\], got \[\]"),
        (1.0, {"frames": 16}, r"frames: expected a list such as \[16, 256\], got 16"),
        (1.0, {"frames": "16"}, r"frames: expected a list such as \[16, 256\], got '16'"),
        (1.0, {"frames": [0, 1]}, "frames: expected a whole number from 1 to 2147483647, got 0"),
        (1.0, {"frames": [2**40]}, "frames: expected a whole number from 1 to 2147483647"),
        (1.0, {"frames": [1.5]}, "frames: expected a whole number .*, got 1.5"),
        (1.0, {"frames": ["a"]}, "frames: expected a whole number .*, got 'a'"),
        (1.0, {"target_psnr": -3.0}, "target_psnr: expected a number from 0 to 200, got -3.0"),
        (1.0, {"target_psnr": "1"}, "target_psnr: expected a number from 0 to 200, got '1'"),
        (1.0, {"max_intensity": 0.0}, "max_intensity: expected a finite number above 0, got 0.0"),
        (1.0, {"max_intensity": "1"}, "max_intensity: expected a finite number above 0, got '1'"),
    ],
)
def test_invalid_arguments_are_refused(light, options, message):
    with pytest.raises(ValueError, match=message):
        jl.plan(jl.Sensor(), light, **options)


def test_the_optimal_light_of_jots_that_detect_little_is_high():
    plan = jl.plan(jl.Sensor(efficiency=0.005), 50.0, frames=[16])
    assert plan.optimal_light == pytest.approx(1.5936 / 0.005, rel=2e-3)


@pytest.mark.parametrize(
    "options", [{"bit_depth": 8}, {"bit_depth": 12}, {"bit_depth": 4, "efficiency": 0.01}], ids=str
)
def test_the_optimal_light_of_several_bits_is_near_saturation(options):
    sensor = jl.Sensor(**options)
    found = jl.plan(sensor, 1.0, frames=[1]).optimal_light
    highest = sensor.max_reading / sensor.efficiency
    assert 0.7 * highest < found < highest
    light = np.linspace(0.5, 2, 5001) * highest
    assert found == pytest.approx(light[np.argmax(snr_bound(sensor, light))], rel=3e-3)
