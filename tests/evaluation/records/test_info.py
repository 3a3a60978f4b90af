"""What an estimate states about itself, and how an image of several planes was estimated."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.iterative.convergence import ConvergenceHistory
from jotlight.evaluation.records.info import Info, join_infos


def test_joined_infos_have_the_histories_of_all_planes_and_no_time_yet():
    histories = [ConvergenceHistory(True, {}, 0.0) for _ in range(3)]
    one = Info("mle-iterative", "iterative", "requested", 0.5, histories[0])
    two = Info("mle-iterative", "iterative", "requested", 0.5, histories[1:])
    joined = join_infos([one, two], "menon")
    assert (joined.method, joined.title) == ("mle-iterative", "iterative, menon")
    assert all(found is each for found, each in zip(joined.history, histories, strict=True))
    assert joined.seconds == 0
    assert join_infos([Info("mle", "likelihood", "requested")], "menon").history is None


def test_the_weights_of_joined_infos_are_the_means_of_those_of_all_planes():
    infos = [
        Info("blend", "blend", "requested", shares=shares)
        for shares in ({"mle": 0.25, "network": 0.75}, {"network": 1.0})
    ]
    assert join_infos(infos, "menon").shares == pytest.approx({"mle": 0.125, "network": 0.875})


@pytest.mark.parametrize("method", ["mle", "mle-iterative"])
def test_methods_without_a_prior_find_no_settings(method):
    bits = jl.Sensor(frames=4).expose(np.full((5, 6), 0.5), rng=0)
    _, info = jl.reconstruct(bits, method=method, return_info=True)
    assert info.found_settings() == {}


def test_a_weight_of_the_caller_is_not_found():
    bits = jl.Sensor(frames=4).expose(np.full((5, 6), 0.5), rng=0)
    _, info = jl.reconstruct(bits, method="admm-tv", weight=2.0, return_info=True)
    assert info.found_settings() == {}


def test_the_weight_is_the_mean_over_all_channels():
    bits = jl.Sensor(frames=8).expose(np.full((8, 8, 3), (0.1, 0.5, 0.9)), rng=0, channel_axis=-1)
    options = {"method": "admm-tv", "return_info": True}
    _, info = jl.reconstruct(bits, **options)
    expected = np.mean([each.weight for each in info.history])
    assert info.found_settings() == {"mean_weight": pytest.approx(expected, rel=1e-6)}
    assert len(info.history) == 3
