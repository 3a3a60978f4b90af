"""The colors of the overlays differ, also for color-blind readers."""

import itertools
import re
from importlib.resources import files

import numpy as np
import pytest

PAGE = files("jotlight.view").joinpath("page")

BLINDNESS = {
    "none": np.eye(3),
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
"""Linear RGB as color-blind readers see it (Machado, Oliveira, and Fernandes, 2009)."""

MIN_DIFFERENCE = 25.0
"""Difference of two colors in CIELAB. The smallest visible one is about 2."""


def overlay(name):
    found = re.search(rf"--{name}: #([0-9a-f]{{6}});", PAGE.joinpath("theme.css").read_text())
    return np.array(list(bytes.fromhex(found[1])), float)


def differences():
    """Return colors of the scale of differences, from blue over gray to orange."""
    text = PAGE.joinpath("layout.css").read_text()
    ramp = re.search(r"\.ramp\.difference .*", text)[0]
    ends = [np.array(each.split(), float) for each in re.findall(r"rgb\(([\d ]+)\)", ramp)]
    parts = np.linspace(0, 1, 21)[:, None]
    return [each for a, b in itertools.pairwise(ends) for each in a * (1 - parts) + b * parts]


def lab(color, blindness):
    level = color / 255
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.asarray(BLINDNESS[blindness]) @ linear, 0, 1)
    white = [0.9505, 1.0, 1.089]
    xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]] @ seen
    x, y, z = np.cbrt(xyz / white)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("blindness", BLINDNESS)
def test_uncertainty_looks_like_no_difference_and_like_no_flag(blindness):
    uncertain = lab(overlay("uncertain"), blindness)
    others = [*differences(), *map(overlay, ("dead", "hot", "saturated"))]
    for other in others:
        assert np.linalg.norm(uncertain - lab(other, blindness)) > MIN_DIFFERENCE, other
