"""Tests of jotlight.networks.color.color_inference."""

from typing import Any

import numpy as np
import pytest

import jotlight as jl
from jotlight.metrics import psnr
from jotlight.networks.color import color_inference
from jotlight.networks.color.color_inference import _local_trials, _run, _weights
from jotlight.networks.planes.color_planes import DEVIATIONS, PLANES, START
from jotlight.networks.planes.planes_layers import CENTER
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.parameters.binomial import squared_sine
from jotlight.sensing.sensor import Sensor


def _counted(trials: Any, shape: tuple[int, int] = (8, 40)) -> PixelCounts:
    return PixelCounts(Sensor(), np.zeros(shape, np.int32), trials, 1.0, 0.0, False)


class _States:
    """A network that returns its number of trials, and keeps it."""

    trials_range = 1, 64

    def __init__(self) -> None:
        self.levels: list[float] = []

    def estimate_probability(self, planes: Any, trials: float, *, threads: int | None) -> Any:
        assert planes == trials  # planes are those of the same level
        self.levels.append(trials)
        return np.full((3, 8, 40), trials, np.float32)


def test_a_number_of_trials_is_one_level():
    network: Any = _States()
    planes: Any = float
    _run(network, planes, 16, None)
    assert network.levels == [16]


def test_the_network_runs_at_levels_that_fit_the_trials_of_each_pixel():
    network: Any = _States()
    trials = np.where(np.arange(40) < 20, 8, 32) * np.ones((8, 1), np.float32)
    planes: Any = float
    found = _run(network, planes, trials, None)
    assert min(network.levels) == 8
    assert max(network.levels) == 32
    np.testing.assert_array_equal(found[:, :, :20], 8)
    np.testing.assert_array_equal(found[:, :, 20:], 32)


@pytest.mark.parametrize(("trials", "gain"), [(32, 1), (64, 1), (256, 2), (6400, 10)])
def test_deviations_have_the_noise_of_the_largest_number_of_trials_of_the_network(trials, gain):
    seen = []

    class Follower(_States):
        """A network whose colors follow the deviations."""

        def estimate_probability(self, planes: Any, trials: float, *, threads: int | None) -> Any:
            seen.append(planes[0, 0, 0])
            return squared_sine(planes[START] + np.float32(CENTER) + planes[:3])

    planes = np.zeros((PLANES, 8, 40), np.float32)
    planes[DEVIATIONS], planes[START] = 0.01, -0.2
    network: Any = Follower()
    found = _run(network, lambda _: planes.copy(), trials, None)
    assert seen[0] == pytest.approx(0.01 * gain)
    np.testing.assert_allclose(found, squared_sine(np.full((3, 8, 40), CENTER - 0.19)), rtol=1e-5)


def test_the_local_trials_of_channels_are_their_mean():
    assert _local_trials([_counted(16), _counted(16), _counted(16)], None) == 16
    assert _local_trials([_counted(4), _counted(6), _counted(8)], None) == 6


def test_filters_that_say_little_do_not_hide_what_the_others_say():
    board = np.where(np.indices((8, 40)).sum(axis=0) % 2, 16.0, 1.0)
    local = _local_trials([_counted(board)], None)
    np.testing.assert_allclose(local, 8.5, atol=0.6)


def test_channels_that_say_nothing_do_not_count():
    assert _local_trials([_counted(np.zeros((8, 40))), _counted(8), _counted(8)], None) == 8
    assert _local_trials([_counted(np.zeros((8, 40)))] * 3, None) == 1


def test_weights_are_those_of_pixels_with_fewer_trials_than_the_network_expects():
    counted = _counted(np.array([[0.0, 4.0, 8.0, 16.0]]), (1, 4))
    assert _weights(counted, 8).tolist() == [[0, 0.5, 1, 1]]


@pytest.mark.slow
def test_levels_improve_a_bracket_behind_a_mosaic(monkeypatch):
    # Bright pixels of a bracket have fewer equivalent trials than dark ones. With one number of
    # trials, colors behind CMYG had dark cracks.
    from skimage.data import astronaut

    image = (astronaut()[:96, 170:266] / 255.0) ** 2.2
    gain = np.repeat([4.0, 1.0, 0.25], 16)
    bits = Sensor(frames=48, gain=gain, mosaic="CMYG").expose(image, rng=1)
    with_levels = psnr(jl.reconstruct(bits), image, data_range=1.0)

    def median(channels: Any, threads: Any) -> int:
        return round(float(np.median([each.trials for each in channels])))

    monkeypatch.setattr(color_inference, "_local_trials", median)
    assert with_levels > psnr(jl.reconstruct(bits), image, data_range=1.0) + 0.2
