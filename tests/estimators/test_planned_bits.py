"""The plan of plain bits."""

import numpy as np

import jotlight as jl
from jotlight.estimators import planned_bits


def test_sums_over_a_subset_of_many_counts_equal_sums_over_all(monkeypatch):
    options = {"frames": [200_000], "max_intensity": 3.0}
    subset = jl.plan(jl.Sensor(), (0.3, 3.2), **options)
    monkeypatch.setattr(planned_bits, "COUNTS_PER_SIGMA", 10**9)
    complete = jl.plan(jl.Sensor(), (0.3, 3.2), **options)
    np.testing.assert_allclose(subset.rmse, complete.rmse, rtol=1e-9)
    np.testing.assert_allclose(subset.psnr, complete.psnr, rtol=1e-6)
