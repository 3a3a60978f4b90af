"""The reference sensor of equivalent counts, where readings have many dark counts."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.readings.merge_near import Merging
from jotlight.estimators.readings.reference_sensors import reference_dark_counts, reference_sensor
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.likelihood.multibit import reading_probability
from jotlight.sensing.likelihood.reference import reading_information
from jotlight.sensing.parameters.response import detection_probability, intensity_at_probability

HOT = np.arange(1024).reshape(32, 32) % 50 == 9


@pytest.mark.parametrize(
    "options",
    [
        {"bit_depth": 12, "gain": 8000.0, "dark_counts": 50.0},
        {"bit_depth": 12, "gain": 8000.0, "dark_counts": 800.0},
        {"bit_depth": 8, "gain": 400.0, "dark_counts": 50.0, "read_noise": 0.3},
        {"gain": 560.0, "dark_counts": 15.0, "threshold": np.tile([40, 60], 4)},
    ],
    ids=str,
)
def test_equivalent_counts_are_right_with_many_dark_counts(options):
    sensor, intensity = jl.Sensor(frames=8, **options), 0.5
    data = sensor.expose(np.full((32, 32), intensity), rng=0)
    merged = Merging(joint_likelihood(data, sensor, None)).near_neighbors()
    light = merged.sensor.light_per_intensity
    p = merged.ones.sum() / np.sum(merged.trials * np.ones(merged.shape))
    threshold, dark_counts = merged.sensor.threshold, np.max(merged.dark_counts)
    found = intensity_at_probability(threshold, p, 1 - p, light, dark_counts)
    assert found == pytest.approx(intensity, rel=0.02)


@pytest.mark.parametrize("hot", [12.0, 900.0])
@pytest.mark.parametrize(
    "options", [{"bit_depth": 8, "gain": 400.0}, {"gain": 8.0}], ids=["several bits", "bits"]
)
def test_hot_jots_with_read_noise_do_not_change_their_pixels(options, hot):
    sensor = jl.Sensor(
        frames=8, read_noise=0.3, dark_counts=np.where(HOT, hot, 0.1), max_intensity=3.0, **options
    )
    data = sensor.expose(np.full(HOT.shape, 0.5), rng=0)
    estimate = jl.reconstruct(data, sensor, method="noniterative-tv")
    assert estimate[HOT].mean() == pytest.approx(0.5, abs=0.06)


def test_dark_counts_shrink_with_the_light_of_a_jot():
    sensor = jl.Sensor(frames=4, gain=400.0, bit_depth=8, dark_counts=20.0)
    reference = reference_sensor(sensor)
    share = reference.gain / sensor.gain
    assert reference.light_per_intensity + reference.dark_counts == pytest.approx(0.25)
    assert reference.dark_counts == pytest.approx(20 * share)
    maps = reference_dark_counts(sensor, reference, np.array([[0.0, 20.0, 1e9]]))
    np.testing.assert_allclose(maps, [[0, 20 * share, 3]])


def test_a_bracket_keeps_its_dark_counts():
    sensor = jl.Sensor(frames=3, gain=[0.3, 1.0, 9.0], dark_counts=0.1)
    assert reference_sensor(sensor).dark_counts == 0.1


@pytest.mark.parametrize(
    ("options", "threshold"),
    [
        ({"threshold": 16, "read_noise": 0.3}, 16),
        ({"threshold": 2, "read_noise": 0.4}, 2),
        ({"threshold": [19, 21] * 4}, 19),
        ({"threshold": np.tile([[19, 21]], (4, 2))}, 19),
        ({"threshold": 20, "gain": np.tile([18.0, 22.0], 4)}, 17),
        ({"threshold": [1, 20] * 4}, 1),
        ({"threshold": 20, "gain": np.tile([1.0, 64.0], 4)}, 1),
        ({"bit_depth": 2, "read_noise": 0.3}, 1),
        ({"threshold": 2, "read_noise": 0.4, "gain": 8.0}, 1),  # so dim that noise makes most ones
        ({"threshold": 4, "read_noise": 0.4, "gain": 12.0}, 1),
        ({"threshold": 8, "read_noise": 0.4, "gain": 8.0}, 8),
    ],
    ids=str,
)
def test_the_threshold_is_that_of_readings_that_are_nearly_alike(options, threshold):
    sensor = jl.Sensor(**{"frames": 8, "gain": 160.0} | options)
    assert reference_sensor(sensor).threshold == threshold


def test_bits_with_read_noise_have_the_dark_counts_of_as_many_ones():
    sensor = jl.Sensor(frames=8, gain=16.0, threshold=2, read_noise=0.4, dark_counts=0.2)
    reference = reference_sensor(sensor)
    bits = sensor.replace(frames=100_000).expose(np.zeros((1, 4)), rng=0)
    expected = bits.to_array().mean()
    assert reference.threshold == 2
    assert detection_probability(2, reference.dark_counts) == pytest.approx(expected, rel=0.02)


def test_a_jot_of_a_map_of_thresholds_counts_once():
    noise = {"read_noise": 0.4, "dark_counts": 0.02}
    sensor = jl.Sensor(frames=8, gain=32.0, threshold=[[2, 2, 2, 3]], **noise)
    reference, dark = reference_sensor(sensor), np.array([0.02])
    ones = [reading_probability(1, dark, read_noise=0.4, threshold=q)[0] for q in (2, 3)]
    assert reference.threshold == 2
    expected = 0.75 * ones[0] + 0.25 * ones[1]
    assert detection_probability(2, reference.dark_counts) == pytest.approx(expected)


@pytest.mark.parametrize("intensity", [0.1, 0.15, 2.0, 3.0])
@pytest.mark.parametrize(
    "options", [{"threshold": 16, "read_noise": 0.3}, {"threshold": [15, 17] * 8}], ids=str
)
def test_counts_tell_nothing_about_light_of_which_the_readings_tell_nothing(options, intensity):
    """Trials with the threshold 1 had up to 250,000 times the information of these readings."""
    sensor = jl.Sensor(frames=16, gain=384.0, max_intensity=9.0, **options)
    joint = joint_likelihood(sensor.expose(np.full((24, 24), intensity), rng=0), sensor, None)
    merged = Merging(joint).near_neighbors()
    light = merged.sensor.light_per_intensity
    each = light**2 * reading_information(merged.sensor, np.array([light * intensity]))
    ratio = float(np.mean(merged.trials) * each[0] / joint.information(intensity)[0, 0])
    assert 0.05 < ratio < 20
