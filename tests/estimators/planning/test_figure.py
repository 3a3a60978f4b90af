import numpy as np

import jotlight as jl


def test_the_bound_of_one_level_of_light_is_drawn_over_the_frames():
    plan = jl.plan(jl.Sensor(), 0.5, frames=[1, 4, 16])
    _, axes = plan.plot().axes
    snr, bound = axes.lines
    np.testing.assert_array_equal(snr.get_xydata(), np.stack([plan.frames, plan.snr[:, 0]], -1))
    np.testing.assert_array_equal(bound.get_ydata(), plan.snr_bound[:, 0])
    assert bound.get_linestyle() == ":"


def test_the_legend_of_a_plan_covers_no_curve():
    figure = jl.plan(jl.Sensor(), (0.05, 2.0), frames=[1, 4, 16]).plot()
    figure.draw_without_rendering()
    axes = figure.axes[1]
    legend = axes.get_legend().get_window_extent()
    assert axes.get_window_extent().x1 <= legend.x0
    assert legend.x1 <= figure.bbox.x1
