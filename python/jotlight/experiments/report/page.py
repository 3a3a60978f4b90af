"""A report as one HTML page that opens from disk and fetches nothing."""

import base64
import dataclasses
import hashlib
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path

from jotlight.experiments.report.content import (
    Curves,
    Report,
    Scene,
    SceneImage,
    Section,
    Value,
)
from jotlight.experiments.report.contrast import themed
from jotlight.experiments.report.curves import BACKGROUND_ID, MUTED_COLOR, TEXT_COLOR

_MAX_OPEN_ROWS = 15
"""The longest table that is open at first. Longer tables are collapsed."""

_MIN_SMOOTH_WIDTH = 160
"""The width in pixels from which an enlarged area is smoothed. Narrower ones show their pixels."""

_WIDE = 500
"""The width in points beyond which a drawing has a row to itself."""

_THEME_COLORS = {TEXT_COLOR: "var(--ink)", MUTED_COLOR: "var(--quiet)"}
"""Colors of a drawing that follow the page's theme, so it is readable on a dark background."""


def render_page(report: Report) -> str:
    """Return the whole report as one HTML document.

    The document contains its styles, script, drawings, and images, each image once.

    Raises
    ------
    ValueError
        If an image is no PNG, JPEG, or WebP, or a drawing is no SVG.

    Examples
    --------
    >>> render_page(Report("Two <methods>", "", [], [])).splitlines()[0]
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
        # The browser runs the script with this digest only, whatever names and drawings contain.
        digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        is_long=lambda table: len(table.rows) > _MAX_OPEN_ROWS,
        sorting_value=_sorting_value,
    )


@dataclasses.dataclass(frozen=True)
class _Drawing:
    curves: Curves
    anchor: str
    svg: str
    width: float
    """Width in points."""

    @property
    def wide(self) -> bool:
        return self.width > _WIDE


@dataclasses.dataclass(frozen=True)
class _EmbeddedImage:
    """An image as the page holds it."""

    source: SceneImage
    data_uri: str
    coarse: bool
    """Whether the enlarged area has fewer pixels than the screen gives it."""


@dataclasses.dataclass(frozen=True)
class _Section:
    section: Section
    anchor: str
    drawings: Sequence[_Drawing]
    scenes: Sequence[tuple[Scene, Sequence[_EmbeddedImage]]]


class _Anchors:
    """A source of ids that are legal, readable, and unique."""

    def __init__(self) -> None:
        self._taken = {"contents", "claims", "theme"}

    def add(self, name: str) -> str:
        """Return a new id made of a name."""
        base = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "part"
        anchor, number = base, 1
        while anchor in self._taken:
            number += 1
            anchor = f"{base}-{number}"
        self._taken.add(anchor)
        return anchor


def _read(name: str) -> str:
    return Path(__file__).with_name(name).read_text("utf-8")


def _section(section: Section, anchors: _Anchors) -> _Section:
    anchor = anchors.add(section.name)
    return _Section(
        section,
        anchor,
        [_drawing(curves, anchors.add(f"{anchor}-{curves.name}")) for curves in section.curves],
        [(scene, [_embedded(image, scene) for image in scene.images]) for scene in section.scenes],
    )


def _embedded(source: SceneImage, scene: Scene) -> _EmbeddedImage:
    from PIL import Image

    try:
        with Image.open(io.BytesIO(source.file), formats=("PNG", "JPEG", "WEBP")) as image:
            kind, width = str(image.format).lower(), image.width
    except (OSError, SyntaxError) as error:
        raise ValueError(
            f"{scene.title}, {source.title}: expected the bytes of a PNG, JPEG or WebP, "
            f"got {source.file[:12]!r}"
        ) from error
    data_uri = f"data:image/{kind};base64,{base64.b64encode(source.file).decode()}"
    coarse = width * scene.crop[3] / scene.size[1] < _MIN_SMOOTH_WIDTH
    return _EmbeddedImage(source, data_uri, coarse)


def _drawing(curves: Curves, anchor: str) -> _Drawing:
    """Return a Matplotlib SVG as a part of the page, with its own ids and the page's colors."""
    # The drawing is our own, so this parses nothing hostile.
    from xml.etree import ElementTree as ET

    try:
        root = ET.fromstring(curves.svg)  # noqa: S314
    except ET.ParseError as error:
        raise ValueError(f"{curves.title}: expected an SVG, but {error}") from error
    for parent in root.iter():
        # A style sheet in a drawing would apply to the whole page.
        for child in list(parent):
            # The background would hide that of the theme.
            is_background = child.get("id") == BACKGROUND_ID
            if is_background or child.tag.rpartition("}")[2] in ("metadata", "style"):
                parent.remove(child)
    for element in root.iter():
        # HTML knows SVG elements by name and needs no namespaces.
        element.tag = element.tag.rpartition("}")[2]
        attributes = {
            name.rpartition("}")[2]: _page_attribute(name, value, anchor)
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


def _page_attribute(name: str, value: str, anchor: str) -> str:
    """Return an attribute's value for the page, where ids begin with the drawing's own."""
    if name == "id":
        return f"{anchor}--{value}"
    if name.endswith("href") and value.startswith("#"):
        return f"#{anchor}--{value[1:]}"
    value = re.sub(r"url\(#", f"url(#{anchor}--", value)
    if name not in ("style", "fill", "stroke"):
        return value

    def shown(found: re.Match[str]) -> str:
        color = found[0].lower()
        return _THEME_COLORS.get(color) or themed(color)

    return re.sub(r"#[0-9a-f]{6}\b", shown, value, flags=re.IGNORECASE)


def _sorting_value(value: Value) -> str:
    """Return a number as the page's script reads it, and "" for text and missing values."""
    if value is None or isinstance(value, str) or math.isnan(value):
        return ""
    return repr(float(value)).replace("inf", "Infinity")
