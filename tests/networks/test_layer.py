"""Layers on their own."""

import numpy as np
import pytest

import jotlight as jl

ONES = np.ones((1, 1, 1, 1))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.ones((1, 1, 1)), np.ones((1, 5)), 0, 1), "filters: expected floats of 4 dimensions"),
        ((np.ones((1, 1, 1, 1), int), np.ones((1, 5)), 0, 1), "filters: .* got int64"),
        ((np.ones((1, 1, 0, 1)), np.ones((1, 5)), 0, 1), "filters"),
        ((ONES * np.nan, np.ones((1, 5)), 0, 1), "filters: expected finite"),
        ((ONES * 1e39, np.ones((1, 5)), 0, 1), "filters: expected finite"),
        ((ONES, np.full((1, 5), np.inf), 0, 1), "coefficients: expected finite"),
        ((ONES, np.ones((2, 5)), 0, 1), "coefficients: expected 1 rows"),
        ((ONES, np.ones((1, 3)), 0, 1), "of 4 to 65536"),
        ((ONES, np.ones((1, 65_537)), 0, 1), "of 4 to 65536"),
        ((ONES, np.ones((1, 5)), np.nan, 1), "start and spacing"),
        ((ONES, np.ones((1, 5)), 1e39, 1), "start and spacing"),
        ((ONES, np.ones((1, 5)), 0, 0), "start and spacing"),
        ((ONES, np.ones((1, 5)), 0, -1), "start and spacing"),
        ((ONES, np.ones((1, 5)), 0, 1e-60), "start and spacing"),
        ((ONES, np.ones((1, 5)), 0, np.inf), "start and spacing"),
    ],
)
def test_a_layer_refuses_arrays_and_knots_that_do_not_fit(arguments, message):
    with pytest.raises(ValueError, match=message):
        jl.Layer(*arguments)


def test_a_layer_keeps_a_read_only_copy_of_its_arrays():
    filters = np.ones((1, 1, 3, 3), np.float32)
    layer = jl.Layer(filters, None)
    filters[:] = 2
    assert (layer.filters == 1).all()
    with pytest.raises(ValueError, match="read-only"):
        layer.filters[:] = 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stride": 0}, "stride: expected 1 to 16, got 0"),
        ({"stride": 17}, "stride: expected 1 to 16, got 17"),
        ({"upsampling": 17}, "upsampling: expected 1 to 16, got 17"),
        ({"stride": 4}, "at least as many rows and columns as the stride of 4"),
        ({"upsampling": 3}, "expected a multiple of 9 filters for an upsampling of 3, got 4"),
        ({"trainable": "some"}, "trainable: expected one of all, filters, nothing, got 'some'"),
    ],
)
def test_a_layer_refuses_wiring_that_does_not_fit_its_filters(options, message):
    with pytest.raises(ValueError, match=message):
        jl.Layer(np.ones((4, 2, 3, 3)), None, **options)


def test_coefficients_have_one_row_per_channel_after_upsampling():
    with pytest.raises(ValueError, match="coefficients: expected 1 rows, one per channel"):
        jl.Layer(np.ones((4, 1, 1, 1)), np.zeros((4, 5)), upsampling=2)
