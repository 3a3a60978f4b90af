"""The HTML page of a report, read by a parser."""

import html
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from jotlight.experiments.report.content import (
    Claim,
    Column,
    Curves,
    Report,
    Scene,
    SceneImage,
    Section,
    Table,
)
from jotlight.experiments.report.page import render_page
from reference.reports import drawing, encoded, hundred_images

HOSTILE = "\"><script>alert(1)</script>'&{{ 7 * 7 }}"
VOID = {"meta", "link", "img", "input", "br"}


class Reader(HTMLParser):
    """The elements and the text of a document, in which every open element must be closed."""

    def __init__(self, document: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.text: list[str] = []
        self.feed(document)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), (tag, names)
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    def values(self, attribute: str) -> list[str]:
        return [attrs[attribute] for _, attrs in self.elements if attribute in attrs]


def scene(*files: bytes, title: str = "scene") -> Scene:
    made = [SceneImage(f"image {index}", "21.3 dB", file) for index, file in enumerate(files)]
    return Scene(title, (8, 8), (1, 2, 4, 4), made)


def file(seed: int, kind: str = "PNG", size: int = 8) -> bytes:
    rng = np.random.default_rng(seed)
    return encoded(rng.integers(0, 256, (size, size), np.uint8), kind)


def report(*sections: Section) -> Report:
    return Report("A report", "Text.", [("name", "value")], sections)


@pytest.fixture(scope="module")
def full() -> str:
    svg = drawing(logarithmic=True)
    return render_page(
        report(
            Section(
                "one",
                "One",
                "Text.",
                "jotlight experiments one",
                claims=[Claim("10 dB", "11 dB", "better", "why"), Claim("a", "b", "not tested")],
                tables=[hundred_images(np.random.default_rng(0))],
                curves=[Curves("same", "One", svg), Curves("same", "Two", svg)],
                scenes=[scene(file(1), file(2, "JPEG"), file(3, "WEBP", 32))],
            ),
            Section("one", "Another of this name", "", "", curves=[Curves("same", "Three", svg)]),
        )
    )


@pytest.mark.slow
def test_every_element_is_closed_and_every_id_is_unique(full):
    reader = Reader(full)
    ids = reader.values("id")
    assert len(ids) == len(set(ids))
    assert not any(re.search(r"\s", name) for name in ids)
    referred = {value[1:] for value in reader.values("href") if value.startswith("#")}
    referred |= set(re.findall(r"url\(#([^)]+)\)", full)) | set(reader.values("aria-labelledby"))
    assert len(referred) > 10
    assert referred <= set(ids)


@pytest.mark.slow
def test_the_page_fetches_nothing(full):
    assert not re.findall(r"(?:https?:)?//\w+\.\w+", re.sub(r"base64,[^\"]+", "", full))
    sources = Reader(full).values("src")
    assert sources
    assert all(source.startswith("data:image/") for source in sources)
    assert "@import" not in full
    assert "default-src 'none'" in full


def test_all_text_is_escaped():
    hostile = Section(
        HOSTILE,
        HOSTILE,
        HOSTILE,
        HOSTILE,
        claims=[Claim(HOSTILE, HOSTILE, "not reproduced", HOSTILE)],
        tables=[Table(HOSTILE, [Column(HOSTILE)], [[HOSTILE]], HOSTILE)] * 2,
        curves=[Curves(HOSTILE, HOSTILE, "<svg xmlns='http://www.w3.org/2000/svg'/>", HOSTILE)],
        scenes=[
            Scene(HOSTILE, (8, 8), (0, 0, 4, 4), [SceneImage(HOSTILE, HOSTILE, file(1))] * 2),
        ],
    )
    made = render_page(Report(HOSTILE, HOSTILE, [(HOSTILE, HOSTILE)], [hostile]))
    reader = Reader(made)
    assert [tag for tag, _ in reader.elements].count("script") == 1
    assert HOSTILE not in made
    assert html.escape("<script>alert(1)") in made
    assert not any(name.startswith("on") for _, attrs in reader.elements for name in attrs)


def test_each_image_is_embedded_once(full):
    assert full.count("base64,") == 3
    for kind in ("png", "jpeg", "webp"):
        assert full.count(f"data:image/{kind};base64,") == 1


@pytest.mark.parametrize("wrong", [b"", b"GIF89a\x01\x00\x01\x00", b"<svg/>", file(1)[:20]])
def test_bytes_that_are_no_image_are_rejected(wrong):
    with pytest.raises(ValueError, match=r"street, image 1: expected the bytes of a PNG"):
        render_page(
            report(Section("a", "A", "", "", scenes=[scene(file(1), wrong, title="street")]))
        )


@pytest.mark.parametrize("wrong", ["", "<svg", "<p/>"])
def test_a_drawing_that_is_no_svg_is_rejected(wrong):
    with pytest.raises(ValueError, match="PSNR: expected an SVG"):
        render_page(report(Section("a", "A", "", "", curves=[Curves("psnr", "PSNR", wrong)])))


def test_drawings_use_the_pages_colors_and_lose_their_style_sheets(full):
    drawings = re.findall(r"<svg role|<svg [^>]*role=\"img\".*?</svg>", full, re.S)
    assert len(drawings) == 3
    for each in drawings:
        assert "var(--ink)" in each
        assert "patch_1" not in each  # the white of the file, which the page does not show
        assert "var(--quiet)" in each
        assert "#1d2733" not in each
        assert "#1f77b4" in each
        assert "<style" not in each
        assert "<metadata" not in each
        assert 'aria-label="' in each
        assert "trials per pixel, K" in each


def test_tables_contain_every_cell_and_long_tables_are_collapsed(full):
    table = hundred_images(np.random.default_rng(0))
    words = {word.strip() for word in Reader(full).text}
    for row in range(len(table.rows)):
        for column in range(len(table.columns)):
            assert table.cell(row, column) in words
    assert full.count("<details") == 1
    assert "100 rows" in full
    assert "<details open" not in full


def test_numbers_sort_as_numbers_and_missing_values_are_marked():
    rows = [["b", 2.0, None], ["a", float("inf"), "word"], [None, float("nan"), 10]]
    table = Table("t", [Column("x"), Column("y", ".1f", "lowest"), Column("z")], rows)
    cells = [
        (attrs.get("class", ""), attrs.get("data-value"), "data-missing" in attrs)
        for tag, attrs in Reader(
            render_page(report(Section("a", "A", "", "", tables=[table])))
        ).elements
        if tag == "td" or attrs.get("scope") == "row"
    ]
    assert [missing for _, _, missing in cells] == [*[False] * 2, True, *[False] * 3, True, True, 0]
    assert [value for _, value, _ in cells if value] == ["2.0", "Infinity", "10.0"]
    assert ["number" in name for name, _, _ in cells] == [False, True, False] * 3


def test_verdicts_appear_as_text_and_are_counted(full):
    assert full.count('class="badge better">better<') == 2
    assert full.count('class="badge not-tested">not tested<') == 2


def test_small_images_show_their_pixels_and_large_ones_are_smoothed():
    made = render_page(
        report(Section("a", "A", "", "", scenes=[scene(file(1), file(2, size=800))]))
    )
    images = [attrs for tag, attrs in Reader(made).elements if tag == "img" and "src" in attrs]
    assert [image.get("class") for image in images] == ["coarse", None]
    assert all("width: 200.0%" in image["style"] for image in images)
    assert all("left: -50.0%; top: -25.0%" in image["style"] for image in images)


def test_an_empty_report_makes_a_page():
    reader = Reader(render_page(Report("Nothing", "", [], [Section("a", "A", "", "")])))
    assert "Nothing" in reader.text


def test_a_scene_without_images_shows_its_title_only():
    made = render_page(
        report(Section("a", "A", "", "", scenes=[Scene("bare", (8, 8), (0, 0, 4, 4), [])]))
    )
    assert "bare" in made
    assert "<select" not in made
