"""The plan of plain bits."""

import numpy as np

import jotlight as jl
from jotlight.estimators.planning import planned_bits


def test_sums_over_a_subset_of_many_counts_equal_sums_over_all(monkeypatch):
    options = {"frames": [200_000], "max_intensity": 3.0}
    subset = jl.plan(jl.Sensor(), (0.3, 3.2), **options)
    monkeypatch.setattr(planned_bits, "COUNTS_PER_SIGMA", 10**9)
    complete = jl.plan(jl.Sensor(), (0.3, 3.2), **options)
    np.testing.assert_allclose(subset.rmse, complete.rmse, rtol=1e-9)
    np.testing.assert_allclose(subset.psnr, complete.psnr, rtol=1e-6)


def test_bits_that_dark_counts_saturate_have_no_estimates_below_0():
    plan = jl.plan(jl.Sensor(dark_counts=3.0), (0.01, 3.0), frames=[1, 10, 1000])
    # One or ten bits are expected to be all ones in darkness, so S is 0.
    np.testing.assert_allclose(plan.bias[:2], -np.stack([plan.light] * 2))
    np.testing.assert_allclose(plan.snr[:2], 0, atol=1e-9)
    assert (plan.bias[2] > -plan.light).all()
