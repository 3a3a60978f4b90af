"""A report as one HTML page that opens from disk and fetches nothing from anywhere."""

import base64
import dataclasses
import hashlib
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path

from jotlight.experiments.report.curves import INK, QUIET
from jotlight.experiments.report.section import (
    Curves,
    Picture,
    Report,
    Scene,
    Section,
    Table,
    Value,
)

_LONG = 15
"""Rows; a table with more is folded up at first."""
_FINE = 160
"""Pixels; an enlarged part that has fewer across shows them as squares, one with more is smooth,
for at about its own size squares would be uneven and a finer picture's would be lost."""
_WIDE = 500
"""Points; a wider drawing gets a row of its own."""
_COLOURS = {INK: "var(--ink)", QUIET: "var(--quiet)"}
"""The colours of words, axes and grids in a drawing, which follow the page's so that it is
readable on a dark ground too."""


def page(report: Report) -> str:
    """Give the whole report as one HTML document.

    Styles, script, drawings and pictures are in it, each picture once.

    Raises
    ------
    ValueError
        When a picture is no PNG, JPEG or WebP, or a drawing no SVG.

    Examples
    --------
    >>> page(Report("Two <methods>", "", [], [])).splitlines()[0]
    '<!doctype html>'
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    style, script, template = (_read(f"page.{ending}") for ending in ("css", "js", "html"))
    anchors = _Anchors()
    sections = [_section(section, anchors) for section in report.sections]
    claims = [(claim, shown) for shown in sections for claim in shown.section.claims]
    verdicts = [claim.verdict for claim, _ in claims]
    return environment.from_string(template).render(
        report=report,
        sections=sections,
        claims=claims,
        counts=[(verdict, verdicts.count(verdict)) for verdict in dict.fromkeys(verdicts)],
        style=style,
        script=script,
        # The browser runs this script and no other, whatever stands in names and drawings.
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        is_long=lambda table: len(table.rows) > _LONG,
        is_numeric=_is_numeric,
        sorting_value=_sorting_value,
    )


@dataclasses.dataclass(frozen=True)
class _Drawing:
    curves: Curves
    anchor: str
    svg: str
    width: float
    """Points."""

    @property
    def wide(self) -> bool:
        return self.width > _WIDE


@dataclasses.dataclass(frozen=True)
class _Shown:
    """A picture as the page shows it."""

    picture: Picture
    address: str
    """The file itself, as a data URI."""
    coarse: bool
    """Whether its enlarged part has fewer pixels than the screen gives it."""


@dataclasses.dataclass(frozen=True)
class _Section:
    section: Section
    anchor: str
    drawings: Sequence[_Drawing]
    scenes: Sequence[tuple[Scene, Sequence[_Shown]]]


class _Anchors:
    """Ids that are legal, readable and different from each other."""

    def __init__(self) -> None:
        self._taken = {"contents", "claims", "theme"}

    def of(self, name: str) -> str:
        words = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "part"
        anchor, number = words, 1
        while anchor in self._taken:
            number += 1
            anchor = f"{words}-{number}"
        self._taken.add(anchor)
        return anchor


def _read(name: str) -> str:
    return Path(__file__).with_name(name).read_text("utf-8")


def _section(section: Section, anchors: _Anchors) -> _Section:
    anchor = anchors.of(section.name)
    return _Section(
        section,
        anchor,
        [_drawing(curves, anchors.of(f"{anchor}-{curves.name}")) for curves in section.curves],
        [
            (scene, [_shown(picture, scene) for picture in scene.pictures])
            for scene in section.scenes
        ],
    )


def _shown(picture: Picture, scene: Scene) -> _Shown:
    from PIL import Image

    try:
        with Image.open(io.BytesIO(picture.file), formats=("PNG", "JPEG", "WEBP")) as image:
            kind, width = str(image.format).lower(), image.width
    except (OSError, SyntaxError) as error:
        raise ValueError(
            f"{scene.title}, {picture.title}: expected the bytes of a PNG, JPEG or WebP, "
            f"got {picture.file[:12]!r}"
        ) from error
    address = f"data:image/{kind};base64,{base64.b64encode(picture.file).decode()}"
    return _Shown(picture, address, coarse=width * scene.crop[3] / scene.size[1] < _FINE)


def _drawing(curves: Curves, anchor: str) -> _Drawing:
    """Make a matplotlib SVG a part of a page: with ids of its own and the page's colours."""
    # The drawing is our own, so nothing hostile is parsed.
    from xml.etree import ElementTree as ET

    try:
        root = ET.fromstring(curves.svg)  # noqa: S314
    except ET.ParseError as error:
        raise ValueError(f"{curves.title}: expected an SVG, but {error}") from error
    for parent in root.iter():
        # A style sheet in a drawing would hold for the whole page; ours has what it says.
        for child in list(parent):
            if child.tag.rpartition("}")[2] in ("metadata", "style"):
                parent.remove(child)
    for element in root.iter():
        # HTML knows an SVG by its name and needs no name spaces.
        element.tag = element.tag.rpartition("}")[2]
        attributes = {
            name.rpartition("}")[2]: _of_page(name, value, anchor)
            for name, value in element.items()
        }
        element.attrib.clear()
        element.attrib.update(attributes)
    if root.tag != "svg":
        raise ValueError(f"{curves.title}: expected an SVG, got <{root.tag}>")
    root.set("role", "img")
    root.set("aria-label", curves.title)
    box = root.get("viewBox", "").split()
    width = float(box[2]) if len(box) == 4 else 0.0
    return _Drawing(curves, anchor, ET.tostring(root, encoding="unicode"), width)


def _of_page(name: str, value: str, anchor: str) -> str:
    """An attribute's value in the page, where ids begin with the drawing's own."""
    if name == "id":
        return f"{anchor}--{value}"
    if name.endswith("href") and value.startswith("#"):
        return f"#{anchor}--{value[1:]}"
    value = re.sub(r"url\(#", f"url(#{anchor}--", value)
    for colour, variable in _COLOURS.items():
        value = re.sub(colour, variable, value, flags=re.IGNORECASE)
    return value


def _is_numeric(table: Table, column: int) -> bool:
    """Whether a column holds numbers and no words."""
    values = [cells[column] for cells in table.rows if cells[column] is not None]
    return bool(values) and not any(isinstance(value, str) for value in values)


def _sorting_value(value: Value) -> str:
    """A number as the page's script reads it; nothing for words and what is missing."""
    if value is None or isinstance(value, str) or math.isnan(value):
        return ""
    return repr(float(value)).replace("inf", "Infinity")
