"""The files of the page: what is said, and contrast."""

import re
from importlib.resources import files

import pytest

PAGE = files("jotlight.view").joinpath("page")


def read(name):
    return PAGE.joinpath(name).read_text()


def test_only_the_messages_of_the_page_are_said_when_they_change():
    text = read("index.html")
    said = re.findall(r'<(\w+)[^>]* id="([^"]+)"[^>]* role="(?:status|alert)"', text)
    assert said == [("p", "address-note"), ("p", "status"), ("p", "toast")]
    assert "<output" not in text
    # A part that appears together with its text is not said.
    hidden = re.findall(
        r"([^\n}]*):empty \{ display: none", read("layout.css") + read("controls.css")
    )
    assert not {".stage-note", ".toast", "#toast"} & {each.strip() for each in hidden}


def test_what_describes_a_control_exists():
    text = read("index.html")
    names = re.findall(r'aria-describedby="([^"]+)"', text)
    assert names
    for name in " ".join(names).split():
        assert f' id="{name}"' in text


def color(name, theme):
    """Return the red, green, and blue of a color of a theme, and its opacity."""
    text = re.search(rf"--{name}: light-dark\((#\w+), (#\w+)\);", read("theme.css"))
    values = list(bytes.fromhex(text[1 + (theme == "dark")][1:].ljust(8 + 1, "f")[:8]))
    return values[:3], values[3] / 255


def over(name, ground, theme):
    """Return a color over another one, through which that one shines."""
    values, opacity = color(name, theme)
    return [a * opacity + b * (1 - opacity) for a, b in zip(values, ground, strict=True)]


def contrast(one, other):
    def light(values):
        scaled = [each / 255 for each in values]
        r, g, b = (v / 12.92 if v <= 0.03928 else ((v + 0.055) / 1.055) ** 2.4 for v in scaled)
        return 0.2126 * r + 0.7152 * g + 0.0722 * b

    low, high = sorted((light(one), light(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_controls_plots_and_texts_over_the_image_have_enough_contrast(theme):
    ground, raised, ink, quiet, mark, edge, plot = (
        color(name, theme)[0]
        for name in ("ground", "raised", "ink", "quiet", "mark", "edge", "plot")
    )
    wash = over("wash", ground, theme)
    assert contrast(ink, wash) >= 4.5  # the badge
    for image in ([0, 0, 0], [255, 255, 255]):
        assert contrast(quiet, over("over", image, theme)) >= 4.5
    for surface in (ground, raised):
        assert contrast(edge, surface) >= 3
    for surface in (ground, raised, wash):
        assert contrast(plot, surface) >= 3
    assert contrast(mark, ground) >= 3  # the two colors of the frame of the focus
