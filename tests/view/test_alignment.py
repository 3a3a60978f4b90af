"""The alignment of windows: those that can be aligned, and their images."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.view.alignment import alignment_reason, merge_window
from jotlight.view.estimate import estimate
from jotlight.view.facts import describe_capture
from jotlight.view.viewed import FramesGoneError, Viewed

PHOTO = jl.datasets.photograph("camera")[100:124, 180:212]
SEVERAL = jl.Sensor(frames=3, bit_depth=4, gain=60.0)
BRACKET = jl.Sensor(frames=14, gain=np.resize([0.25, 1.0, 4.0], 14))


def viewed_of(sensor):
    return Viewed.from_data(sensor.expose(PHOTO, rng=0))


def test_what_cannot_be_aligned_states_why():
    assert alignment_reason(viewed_of(BRACKET)) is None
    jots = viewed_of(SEVERAL.replace(oversampling=2))
    assert "expected pixels of one jot" in describe_capture(jots)["align_reason"]
    counts = CountStack(np.ones((6, 8, 8), np.uint8), Provenance("npy", "a.npy"), trials=40)
    pixels = Viewed("a.npy", counts, jl.Sensor(oversampling=2, frames=60))
    reason = describe_capture(pixels)["align_reason"]
    assert "pixels; pass oversampling=1 (--oversampling 1) and frames=240" in reason
    with pytest.raises(ValueError, match="two cycles of exposures or more, which are 6 frames"):
        merge_window(viewed_of(BRACKET), range(3, 6), "mle")


def test_plain_bits_can_be_aligned_whatever_frames_have_left_memory():
    class Gone(Viewed):
        def part(self, frames):
            raise FramesGoneError

    bits = jl.Sensor(frames=8).expose(PHOTO, rng=0)
    assert alignment_reason(Gone("live", bits, bits.sensor)) is None


@pytest.mark.slow
def test_an_aligned_window_equals_that_of_the_library():
    scene = jl.datasets.moving(
        motion="shake", sensor=jl.Sensor(frames=32), shape=(64, 64), photons=0.5, rng=0
    )
    viewed = Viewed.from_data(scene.bits)
    merged, _ = merge_window(viewed, range(32), "mle")
    expected = jl.merge(scene.bits, motion=jl.align(scene.bits))
    np.testing.assert_array_equal(merged.ones, expected.ones)
    image = estimate(viewed, range(32), "mle", scene.bits.counts(), merged)
    np.testing.assert_array_equal(image.image, jl.mle(expected))
