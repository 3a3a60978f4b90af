"""Levels for display."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.view.display import display, display_difference, fit_white
from jotlight.view.estimate import Estimate
from jotlight.view.state import ViewState
from jotlight.view.viewed import Viewed

VIEWED = Viewed.from_data(jl.Sensor(frames=4).expose(np.full((2, 2), 0.5), rng=0))


def estimate_of(*values):
    image = np.array([values], np.float32)
    trials = np.full(image.shape, 4.0)
    return Estimate(
        image=image,
        counts=np.zeros(image.shape, int),
        trials=trials,
        sensor=VIEWED.sensor(4),
        method="mle",
        title="",
        seconds=0,
        data=None,
    )


@pytest.mark.parametrize("value", [1e-40, 9e-17, 1.0, 1e13, 1e38])
def test_the_automatic_white_of_every_image_is_one_that_the_page_may_send(value):
    made = estimate_of(0.0, value)
    white = fit_white(VIEWED, range(4), made)
    for stops in (-8, 0, 8):
        state = ViewState.from_json({"white": white * 2.0**stops})
        assert np.isfinite(display(made, state, state.white).tone["axis"]).all()
        difference = display_difference(made, estimate_of(value, 0.0), state.white)
        assert np.isfinite(difference.tone["axis"]).all()


def test_the_white_of_two_channels_is_that_of_their_mean():
    made = estimate_of([0.0, 1.0], [0.5, 0.5])
    assert fit_white(VIEWED, range(4), made) == 0.5
