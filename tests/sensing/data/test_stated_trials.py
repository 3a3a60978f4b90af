"""Counts whose number of trials is stated, of sensors whose readings are no plain bits."""

import numpy as np
import pytest

import jotlight as jl

THRESHOLDS = 1 + np.indices((16, 16)).sum(axis=0) % 2
SENSORS = [
    jl.Sensor(frames=64, gain=64.0, threshold=THRESHOLDS),
    jl.Sensor(frames=64, gain=64.0, read_noise=0.2),
]
SCENE = np.linspace(0.1, 0.9, 256).reshape(16, 16)


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS, ids=["thresholds", "read noise"])
@pytest.mark.parametrize("trials", [64, 16, np.full((16, 16), 16.0)])
def test_counts_with_their_trials_are_estimated_as_their_bits(sensor, trials):
    bits = sensor.expose(SCENE, rng=0)[: int(np.max(trials))]
    for method in ("mle", None):
        found = jl.reconstruct(bits.counts(), sensor, trials=trials, method=method)
        np.testing.assert_allclose(found, jl.reconstruct(bits, method=method), rtol=1e-5)
    interval = jl.uncertainty(bits.counts(), sensor, trials=trials, method="mle")
    expected = jl.uncertainty(bits, method="mle")
    np.testing.assert_allclose(interval.high, expected.high, rtol=1e-5)


def test_the_jots_of_a_pixel_are_several_trials():
    sensor = jl.Sensor(frames=16, oversampling=2, gain=64.0, read_noise=0.2)
    bits = sensor.expose(SCENE, rng=0)[:8]
    found = jl.mle(bits.counts(2), sensor, trials=32)
    np.testing.assert_allclose(found, jl.mle(bits), rtol=1e-5)
    with pytest.raises(ValueError, match=r"expected one multiple of 4 below .* for all pixels"):
        jl.mle(bits.counts(2), sensor, trials=34)


@pytest.mark.parametrize(
    ("sensor", "trials", "message"),
    [
        (SENSORS[0], np.arange(64, 320).reshape(16, 16), "has a threshold for each jot, got "),
        (SENSORS[1], 63.5, "has read noise 0.2, got 63.5; state dead jots with its mask"),
        (SENSORS[0], 0.5, "expected one whole number below"),
        (SENSORS[1], 1e12, r"^trials: expected one whole number below 2\*\*31 for all pixels"),
        (SENSORS[1], 2**31, r"^trials: expected one whole number below 2\*\*31 for all pixels"),
        (SENSORS[0], np.full((3, 3), 64), "trials: expected"),
        (jl.Sensor(frames=2, gain=[1.0, 2.0]), 2, "the frames of the sensor differ"),
    ],
)
def test_other_trials_are_refused(sensor, trials, message):
    counts = np.zeros((16, 16), int)
    with pytest.raises(ValueError, match=message):
        jl.mle(counts, sensor, trials=trials)


def test_counts_above_their_trials_are_refused():
    with pytest.raises(ValueError, match="got 9 of 8 at the index"):
        jl.mle(np.full((16, 16), 9), SENSORS[0], trials=8)
