"""Colors of drawings are visible on both grounds of the report's page."""

import re
from importlib.resources import files

import pytest

from jotlight.experiments.report.contrast import GROUNDS, contrast, themed
from jotlight.experiments.report.curves import METHOD_COLORS, OTHER_COLOR


@pytest.mark.parametrize("color", [*METHOD_COLORS.values(), OTHER_COLOR, "#000000", "#ffffff"])
def test_each_color_is_visible_in_both_themes(color):
    shown = re.findall(r"#[0-9a-f]{6}", themed(color))
    for ground, each in zip(GROUNDS, (shown[0], shown[-1]), strict=True):
        assert contrast(each, ground) >= 3
    if all(contrast(color, ground) >= 3 for ground in GROUNDS):
        assert shown == [color]


def test_the_grounds_are_those_of_the_page():
    style = files("jotlight.experiments.report").joinpath("page.css").read_text()
    assert f"--ground: light-dark({', '.join(GROUNDS)});" in style
