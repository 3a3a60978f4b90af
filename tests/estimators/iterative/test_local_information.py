"""The information at the local light is exact, and hot jots do not hide it."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.iterative.local_information import local_information
from jotlight.sensing.parameters.response import inverse_detection_probability


@pytest.mark.parametrize("threshold", [1, 5])
def test_the_information_is_exact_for_any_number_of_trials_and_of_ones(threshold):
    for trials in (0.7, 16, 10**5, 10**9):
        for ones in {int(share * trials) for share in (0, 1e-8, 1e-6, 1e-4, 0.3, 0.9999, 1)}:
            # 3/8 ones and 3/8 zeros belong to the window, which contains all nine pixels.
            total = 9 * trials + 3 / 4
            p, rest = (9 * ones + 3 / 8) / total, (9 * (trials - ones) + 3 / 8) / total
            light = inverse_detection_probability(threshold, p, rest)
            counts = jl.Likelihood(np.full((3, 3), ones), trials=trials, threshold=threshold)
            problem = jl.Problem(jl.operators.scaling((3, 3), 1.0), counts, 4.0)
            found, skewness = local_information(problem, np.ones((3, 3)), np.ones((3, 3)))
            expected = counts.information(np.full((3, 3), light))
            np.testing.assert_allclose(found, expected, rtol=1e-3)
            np.testing.assert_allclose(
                skewness, binom_skewness(trials, p, rest) ** 2, rtol=1e-6, atol=1e-9
            )


def binom_skewness(trials, p, rest):
    return (rest - p) / np.sqrt(trials * p * rest)


def test_rare_ones_are_not_their_own_neighborhood():
    bits = np.zeros((64, 64), np.int32)
    bits.reshape(-1)[:: 64 * 8 + 24] = 1
    problem = jl.Problem(jl.operators.scaling(bits.shape, 1.0), jl.Likelihood(bits, 16), 4.0)
    light = np.ones(bits.shape)
    information, _ = local_information(problem, light, light)
    expected = problem.likelihood.information(np.full(bits.shape, -np.log1p(-bits.mean() / 16)))
    assert (information < 2 * expected).all()
    assert (information > expected / 2).all()


def test_hot_jots_do_not_hide_the_light_of_their_neighbors():
    hot = np.where(np.random.default_rng(0).random((64, 64)) < 0.05, 2.0, 0.01)
    noise = {}
    for name, dark_counts in (("cold", 0.01), ("some hot", hot)):
        gain = np.repeat([2.4, 0.6, 0.15], 4)
        sensor = jl.Sensor(frames=12, gain=gain, dark_counts=dark_counts)
        bits = sensor.expose(np.full(hot.shape, 0.2), rng=0)
        noise[name] = jl.reconstruct(bits, method="admm-tv")[hot < 1].std()
    assert noise["some hot"] < 3 * noise["cold"]
