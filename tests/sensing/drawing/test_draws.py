"""What a simulation draws: images, seeds, and runs of frames."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.layout import Layout
from jotlight.sensing.drawing.draws import Draw
from jotlight.sensing.drawing.simulate import Window

GRAY = Layout(())


def draw_of(sensor, layout=GRAY, frames=None):
    pixels = np.zeros(layout.shape_of((4, 6)))
    window = Window.from_slices((4, 6), sensor.frames, None, frames)
    return Draw(
        sensor.engine_parts(), pixels, layout, bytes(32), window, None, lambda fraction: None
    )


@pytest.mark.parametrize(
    ("layout", "stack", "channels"),
    [(GRAY, (), 1), (Layout((2, 5)), (2, 5), 1), (Layout((2, 3), -1), (2,), 3)],
)
def test_images_of_stacks_and_colors_are_in_one_order(layout, stack, channels):
    draw = draw_of(jl.Sensor(), layout)
    number = int(np.prod(stack))
    assert (draw.stack, draw.is_color) == (stack, channels > 1)
    assert draw.images.shape == (number, channels, 4, 6)
    assert len(set(draw.seeds)) == number


def test_the_runs_of_all_parts_are_the_frames_of_the_window():
    draw = draw_of(jl.Sensor(frames=8, gain=[1, 1, 1, 4, 4, 1, 1, 1]), frames=slice(1, 8))
    runs = draw.runs(2)
    frames = [list(window.frames) for _, window, _ in runs]
    assert frames == [[1, 2], [5, 6], [7], [3, 4]]
    assert [place.start for *_, place in runs] == [each[0] - 1 for each in frames]
