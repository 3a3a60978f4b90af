"""The page in Chromium shows the sensor, and whether it is assumed."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.view.viewed import Viewed

pytestmark = pytest.mark.slow


def test_a_stated_sensor_is_not_said_to_be_assumed(opened):
    tab = opened("method=mle")
    assert tab.locator("summary", has_text="Sensor").text_content().strip() == "Sensor"
    tab.keyboard.press("8")
    assert tab.locator("#sensor-note").inner_text() == ""


def test_an_assumed_sensor_is_said_to_be_so_before_the_list_is_opened(opened, started):
    running = started(Viewed.from_data(jl.Bits.from_array(np.eye(8, dtype=bool)[None])))
    tab = opened("method=mle", at=running)
    assert tab.locator("summary", has_text="Sensor").text_content().strip() == "Sensor assumed"
    tab.keyboard.press("8")
    note = "The bits do not state their sensor; assumed: Sensor()"
    assert tab.locator("#sensor-note").inner_text() == note
