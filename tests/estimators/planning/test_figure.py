import numpy as np

import jotlight as jl
from jotlight.estimators.planning.figure import draw_map


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


def test_the_color_bar_of_a_map_says_that_values_exceed_it():
    from jotlight.figures import Figure

    image = np.ones((20, 20))
    for value, extend, label in ((1.0, "neither", ""), (7.0, "max", "up to 7")):
        image[3, 4] = value
        figure = Figure(3, 3)
        axes = figure.subplots()
        draw_map(axes, image, "map")
        bar = axes.images[0].colorbar
        assert (bar.extend, bar.ax.get_ylabel()) == (extend, label)
