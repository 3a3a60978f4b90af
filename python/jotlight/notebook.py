"""HTML for notebooks: a small image, and a table of facts."""

import base64
import html
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

_SIDE = 192
"""Maximum height and width of a thumbnail in pixels."""

_MIN_SIDE = 8
"""Minimum height and width of a thumbnail in pixels."""

_WHITE = 99.5
"""Percentile of the pixels that is shown as white."""

_MAX_TEXT = 200
"""Maximum length of a text. Longer texts are cut."""


def card(
    title: str, facts: Mapping[str, object], image: npt.NDArray[np.floating] | bytes | None = None
) -> str:
    """Return HTML with a title, a table of facts, and a small image.

    Texts may come from files of others. They are shown as they are, and cannot act as HTML.

    Parameters
    ----------
    title : str
        The title.
    facts : mapping of str to object
        Names and values.
    image : ndarray, shape (H, W) or (H, W, 3), or bytes, optional
        An image from 0, black, to 1, white, or a PNG, such as the thumbnail of a figure.

    Examples
    --------
    >>> card("Bits", {"frames": 16, "file": "<a>"})
    '<div><div><b>Bits</b></div><table><tr><th>frames</th><td>16</td></tr><tr><th>file</th><td>&lt;a&gt;</td></tr></table></div>'
    """
    rows = "".join(
        f"<tr><th>{_escape(name)}</th><td>{_escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    table = f"<table>{rows}</table>" if rows else ""
    drawing = ""
    if image is not None:
        address = _data_address(image if isinstance(image, bytes) else _png_of(image))
        drawing = f'<div><img alt="{_escape(title)}: image" src="{address}"></div>'
    return f"<div><div><b>{_escape(title)}</b></div>{drawing}{table}</div>"


def text_table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table for terminals, with numbers to the right of the first column.

    Examples
    --------
    >>> print(text_table(["method", "PSNR"], [["mle", "20 dB"]]))
    method   PSNR
    mle     20 dB
    """
    lines = [titles, *rows]
    widths = [max(len(line[column]) for line in lines) for column in range(len(titles))]
    return "\n".join(
        "  ".join(
            text.rjust(width) if column else text.ljust(width)
            for column, (text, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )


def table_of(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return an HTML table with a row of titles.

    Examples
    --------
    >>> table_of(["a"], [[1]])
    '<table><tr><th>a</th></tr><tr><td>1</td></tr></table>'
    """
    head = "".join(f"<th>{_escape(title)}</th>" for title in titles)
    body = ("".join(f"<td>{_escape(value)}</td>" for value in row) for row in rows)
    return f"<table><tr>{head}</tr>{''.join(f'<tr>{row}</tr>' for row in body)}</table>"


def normalize(image: npt.NDArray[Any]) -> npt.NDArray[np.floating]:
    """Return an image (H, W) or (H, W, C) from 0, black, to 1, white, for people to look at.

    White is the 99.5th percentile of the finite values. Values that are not finite are white, too.
    Three channels are colors, and others are averaged.

    Examples
    --------
    >>> normalize(np.array([[0, 5, 10], [10, 10, 10]])).tolist()
    [[0.0, 0.5, 1.0], [1.0, 1.0, 1.0]]
    """
    values = np.asarray(image, np.float64)
    if values.ndim == 3 and values.shape[2] != 3:
        values = values.mean(axis=2)
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return np.ones(values.shape)
    white = float(np.percentile(finite, _WHITE)) or float(finite.max()) or 1.0
    return np.clip(np.where(np.isfinite(values), values / white, 1), 0, 1)


def average_to_side(image: npt.NDArray[np.floating], side: int = _SIDE) -> npt.NDArray[np.floating]:
    """Return an image of at most `side` pixels a side, by averaging squares of pixels.

    Examples
    --------
    >>> average_to_side(np.arange(16.0).reshape(4, 4), 2).tolist()
    [[2.5, 4.5], [10.5, 12.5]]
    """
    factor = -(-max(image.shape[:2]) // side)
    if factor == 1:
        return image
    # Thin images keep at least one row and one column.
    rows, columns = (np.arange(0, length, factor) for length in image.shape[:2])
    totals = np.add.reduceat(np.add.reduceat(image, rows, axis=0), columns, axis=1)
    ones = np.ones(image.shape[:2])
    sizes = np.add.reduceat(np.add.reduceat(ones, rows, axis=0), columns, axis=1)
    return np.asarray(totals / (sizes if image.ndim == 2 else sizes[:, :, None]))


def enlarge(image: npt.NDArray[np.floating], side: int = _SIDE) -> npt.NDArray[np.floating]:
    """Return an image whose pixels are repeated by a whole factor, up to `side` pixels a side.

    Thin images become as thick as the smallest thumbnail.

    Examples
    --------
    >>> enlarge(np.zeros((1, 50)), 100).shape
    (8, 100)
    """
    factor = max(1, side // max(image.shape[:2]))
    rows, columns = (max(factor, -(-_MIN_SIDE // length)) for length in image.shape[:2])
    return np.repeat(np.repeat(image, rows, axis=0), columns, axis=1)


def _escape(value: object) -> str:
    text = str(value)
    return html.escape(text if len(text) <= _MAX_TEXT else text[: _MAX_TEXT - 1] + "…")


def _data_address(png: bytes) -> str:
    """Return the address of a PNG that contains it."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _png_of(image: npt.NDArray[np.floating]) -> bytes:
    """Return a thumbnail of an image as a PNG."""
    from PIL import Image

    shades = np.rint(255 * np.clip(enlarge(average_to_side(image)), 0, 1)).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(shades).save(buffer, "png")
    return buffer.getvalue()
