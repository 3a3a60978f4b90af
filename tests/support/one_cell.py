"""The likelihood of a single cell."""

import numpy as np

import jotlight as jl


def evaluate(ones, trials, light, **options):
    """Return value, gradient, curvature, and information of one cell."""
    cell = jl.Likelihood([ones], trials, **options)
    return (
        cell.value([light]),
        *np.ravel(cell.gradient_and_curvature([light])),
        *cell.information([light]),
    )
