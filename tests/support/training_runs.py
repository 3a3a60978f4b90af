"""Small runs of `jotlight.train`."""

import contextlib
from unittest import mock

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


def end_after(step):
    """Return a callback that ends a run after a step. The record of the result ends nothing."""

    def callback(record):
        if record.step >= step:
            raise StopIteration

    return callback


def assert_same_networks(first, second):
    """Check that two files hold networks with the same parameters."""
    one, two = (parameter_vector(jl.Network.load(path)) for path in (first, second))
    np.testing.assert_array_equal(one, two)


@contextlib.contextmanager
def interrupted_at(step, module, name="train"):
    """Press Ctrl-C at the end of a step of a module's training function, which a command calls."""
    function = getattr(module, name)

    def run(*positional, callback, **options):
        def interrupt(record):
            callback(record)
            if record.step == step:
                raise KeyboardInterrupt

        return function(*positional, callback=interrupt, **options)

    with mock.patch.object(module, name, run):
        yield
