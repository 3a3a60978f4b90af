"""The reference sensor of equivalent counts, where readings have many dark counts."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.readings.merge_near import Merging
from jotlight.estimators.readings.reference_sensors import reference_dark_counts, reference_sensor
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood

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
    ones, trials = merged.ones.sum(), np.sum(merged.trials * np.ones(merged.shape))
    found = (-np.log1p(-ones / trials) - np.max(merged.dark_counts)) / light
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
