"""About how many trials the equivalent counts of a sensor have."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.readings.merge_near import _real_counts
from jotlight.estimators.readings.typical_trials import typical_trials
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood

SHAPE = 8, 8


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=12, gain=np.repeat([8.0, 1.0, 0.125], 4)),
        jl.Sensor(frames=3, gain=4.0, threshold=[1, 2, 2]),
        jl.Sensor(frames=16, gain=32.0, threshold=1 + 3 * (np.indices(SHAPE).sum(axis=0) % 2)),
        jl.Sensor(frames=8, gain=16.0, bit_depth=3, dark_counts=0.1, max_intensity=2.0),
        jl.Sensor(frames=8, gain=16.0, bit_depth=3, read_noise=0.3, efficiency=0.5),
        jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0], oversampling=2),
    ],
    ids=repr,
)
def test_they_are_those_of_counts_near_a_typical_intensity(sensor):
    near = np.full(SHAPE, 0.45 * sensor.max_intensity)
    readings = sensor.expose(np.zeros(SHAPE), rng=0)
    trials = _real_counts(joint_likelihood(readings, sensor, None), near)[1]
    assert typical_trials(sensor) == pytest.approx(np.mean(trials), rel=1e-6)
