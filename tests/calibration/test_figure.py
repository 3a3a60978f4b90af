"""The page of plots of a calibration."""

import numpy as np
import pytest

import jotlight as jl


@pytest.mark.parametrize(
    ("are_bits", "has_flat"),
    [
        (True, False),
        (False, True),
        pytest.param(True, True, marks=pytest.mark.slow),
        pytest.param(False, False, marks=pytest.mark.slow),
    ],
)
def test_panels_without_data_name_what_is_missing(are_bits, has_flat):
    pytest.importorskip("matplotlib")
    sensor = jl.Sensor(frames=256, dark_counts=0.05)
    captures = [sensor.expose(np.full((16, 16), value), rng=0) for value in (0.0, 0.7)]
    data = [each if are_bits else each.counts() for each in captures[: 1 + has_flat]]
    figure = jl.calibrate(*data, frames=None if are_bits else 256).plot()
    panels = [[text.get_text() for text in axes.texts] for axes in figure.axes]
    texts = {text for panel in panels for text in panel}
    untested = "only counts,\nso no test of change over time"
    assert (f"dark: {untested}" in texts) == (not are_bits)
    assert (f"flat: {untested}" in texts) == (has_flat and not are_bits)
    assert ("no flat capture,\nso no test of its change over time" in texts) == (not has_flat)
    assert ("no flat capture, so no response" in texts) == (not has_flat)
