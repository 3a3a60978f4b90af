"""What the page shows about a capture."""

import numpy as np

import jotlight as jl
from jotlight.view.facts import describe_capture
from jotlight.view.viewed import Viewed


def test_a_sensor_that_the_bits_do_not_state_is_said_to_be_assumed():
    bits = jl.Sensor(frames=4, threshold=2).expose(np.full((2, 3), 0.5), rng=0)
    assert describe_capture(Viewed.from_data(bits))["sensor_note"] == ""
    bare = describe_capture(Viewed.from_data(jl.Bits(bits.packed, bits.width)))
    note = "the bits do not state their sensor; assumed: Sensor(frames=4)"
    assert bare["sensor_note"] == note
