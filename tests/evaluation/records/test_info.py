"""How an image of several planes was estimated."""

import pytest

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
