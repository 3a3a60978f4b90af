"""Moving scenes: photographs and sensors that do not fit are reported."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets import moving

CAMERA = jl.datasets.photograph()[100:356, 150:406]


def test_a_photograph_of_gray_levels_is_reported():
    image = 255 * np.indices((40, 40)).sum(axis=0) / 78
    options = {"shape": (32, 32), "photons": 0.3, "rng": 0}
    with pytest.warns(jl.JotlightWarning, match=r"photograph: most intensities .* / 255"):
        moving(image, "shake", sensor=jl.Sensor(frames=16), **options)
    scene = moving(image, "shake", sensor=jl.Sensor(frames=16, max_intensity=255), **options)
    assert scene.image().max() > 100


@pytest.mark.parametrize("name", ["photograph", "foreground"])
def test_gray_levels_are_reported_once_and_not_for_each_frame(name):
    options = {"photograph": CAMERA[:40, :40], "foreground": CAMERA[40:80, :40]}
    options[name] = 255 * options[name]
    sensor = jl.Sensor(frames=4)
    with pytest.warns(jl.JotlightWarning) as caught:
        moving(motion="layers", sensor=sensor, shape=(32, 32), rng=0, **options).bits.to_array()
    [message] = [str(warning.message) for warning in caught]
    assert message.startswith(f"{name}: most intensities should be at most max_intensity=1, but")


@pytest.mark.parametrize(
    ("photograph", "foreground", "expected"),
    [((40, 40), (40, 40, 3), r"\(H, W\)"), ((40, 40, 3), (40, 40), r"\(H, W, 3\)")],
)
def test_a_foreground_of_other_channels_is_refused(photograph, foreground, expected):
    match = rf"foreground: expected .* shape {expected}, got shape .*; read both with gray=True"
    with pytest.raises(ValueError, match=match):
        moving(np.ones(photograph), "layers", foreground=np.ones(foreground))
