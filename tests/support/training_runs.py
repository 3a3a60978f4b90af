"""Small runs of `jotlight.train`."""

import numpy as np

import jotlight as jl
from jotlight.training import Adam, GaussNewton, ProjectedGradient, parameter_vector

SENSOR = jl.Sensor(oversampling=3)
START = jl.Network.initial(SENSOR, taps=3, coefficients=12)
IMAGES = np.random.default_rng(0).random((5, 20, 24), np.float32)
OPTIMIZERS = {"gauss-newton": GaussNewton(), "adam": Adam(), "gradient": ProjectedGradient(1e-3)}
STEPS = 6


def scenes(rng, number):
    return rng.random((number, 16, 16), np.float32)


def train(network=START, images=IMAGES, sensor=None, **options):
    small = {"steps": STEPS, "batch": 7, "rng": 3}
    if not callable(images):
        small["patch"] = 12
    return jl.train(network, images, sensor, **{**small, **options})


def assert_same(one, other):
    (network, history), (again, history_again) = one, other
    np.testing.assert_array_equal(parameter_vector(network), parameter_vector(again))
    assert network.history == again.history
    assert history.to_json() == history_again.to_json()
