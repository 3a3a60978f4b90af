"""Patterns of color mosaics as letters and as values of JSON."""

import base64
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Pattern

MAX_FILTERS = 26
"""Maximum number of filters."""

_ORDER = "RGBWCMY"
"""The letters of ideal filters, in the order of the filters of a mosaic."""

_MAX_PIXELS = 1 << 28
"""Maximum number of pixels of a map in a file."""


def check_number(number: int) -> None:
    """Raise ValueError for more filters than a mosaic may have."""
    if number > MAX_FILTERS:
        raise ValueError(f"mosaic: expected at most {MAX_FILTERS} filters, got {number}")


def read_pattern(given: Any, filters: str | None) -> tuple[Pattern, str]:
    """Return the index into `filters` of each pixel of a pattern, and the filters.

    Raises
    ------
    TypeError, ValueError
        When the pattern has another form, or states a filter that is not in `filters`.

    Examples
    --------
    >>> pattern, filters = read_pattern("GRBG", None)
    >>> pattern.tolist(), filters
    ([[1, 0], [2, 1]], 'RGB')
    """
    if filters is not None and (not isinstance(filters, str) or not filters.isalpha()):
        raise TypeError(
            f"filters: expected a text with a letter for each filter, such as RGBG, got {filters!r}"
        )
    if isinstance(given, list | tuple) and given and all(isinstance(row, str) for row in given):
        given = "/".join(given)
    array = _rows_of_text(given) if isinstance(given, str) else np.asarray(given)
    if array.ndim != 2 or array.size == 0 or array.dtype.kind not in "Uiu":
        raise ValueError(
            "mosaic: expected letters such as RGGB, a 2-D array of letters or of whole numbers, or "
            f"an image (H, W, 3), got {array.dtype} of shape {array.shape}"
        )
    if array.dtype.kind == "U":
        return _of_letters(array, filters)
    if filters is None:
        raise ValueError(
            "mosaic: whole numbers do not say which filters they are; name them, as in "
            'jotlight.Mosaic(pattern, filters="RGBG")'
        )
    check_number(len(filters))
    if array.min() < 0 or array.max() >= len(filters):
        raise ValueError(
            f"mosaic: expected indices from 0 to {len(filters) - 1} into the filters {filters}, "
            f"got {array.min()} to {array.max()}"
        )
    return array.astype(np.uint8), filters


def rank(letter: str) -> tuple[int, str]:
    """Return the place of a filter in the order of filters: known letters come first."""
    return (_ORDER.index(letter) if letter in _ORDER else len(_ORDER)), letter


def _rows_of_text(text: str) -> npt.NDArray[Any]:
    """Return the letters of a text as an array. Four are 2 x 2, and ``/`` ends a row."""
    rows = text.removesuffix("/").split("/")
    if "/" not in text and len(text) == 4:
        rows = [text[:2], text[2:]]
    if len({len(row) for row in rows}) > 1 or not all(row.isalpha() for row in rows):
        raise ValueError(
            "mosaic: expected letters of filters, such as RGGB for 2 x 2 pixels, RGB for 1 x 3, or "
            f"rows of equal length such as RGBW/BWRG, got {text!r}"
        )
    return np.array([list(row) for row in rows])


def _of_letters(array: npt.NDArray[Any], filters: str | None) -> tuple[Pattern, str]:
    letters, places = np.unique(array, return_inverse=True)
    if any(len(letter) != 1 or not letter.isalpha() for letter in letters):
        raise ValueError(f"mosaic: expected one letter for each pixel, got {letters.tolist()}")
    check_number(len(letters))
    if filters is None:
        filters = "".join(sorted(letters, key=rank))
    if unknown := sorted(set(letters) - set(filters)):
        raise ValueError(f"mosaic: expected the filters {filters}, got {', '.join(unknown)}")
    of_letters = np.array([filters.index(letter) for letter in letters], np.uint8)
    return of_letters[places.reshape(array.shape)], filters


def letters_of(pattern: Pattern, filters: str) -> str:
    """Return the letters of a pattern, as :func:`read_pattern` takes them.

    Examples
    --------
    >>> letters_of(np.array([[0, 1, 2]], np.uint8), "RGB")
    'RGB'
    """
    rows = ["".join(filters[place] for place in row) for row in pattern]
    if pattern.shape == (2, 2):
        return "".join(rows)
    return "/".join(rows) + "/" * (pattern.shape == (1, 4))


def compress_map(pattern: Pattern) -> dict[str, Any]:
    """Return a map of filters as compressed text, and its size.

    The size has this name because tifffile takes a TIFF description with "shape" for its own.
    """
    text = base64.b64encode(zlib.compress(pattern.tobytes(), 9)).decode()
    return {"size": list(pattern.shape), "zlib": text}


def pattern_of_json(value: dict[str, Any]) -> Any:
    """Return the pattern in the JSON of a mosaic: letters, or the indices of the filters.

    Raises
    ------
    KeyError, TypeError, ValueError
        When it is damaged.

    Examples
    --------
    >>> pattern_of_json({"pattern": [[0, 1], [1, 2]]})
    [[0, 1], [1, 2]]
    """
    pattern = value["pattern"]
    if not isinstance(pattern, dict):
        return pattern
    height, width = pattern["size"]
    size = int(height) * int(width)
    if not 0 < size <= _MAX_PIXELS:
        raise ValueError(f"mosaic: expected 1 to {_MAX_PIXELS} pixels, got {height} x {width}")
    try:
        data = base64.b64decode(pattern["zlib"], validate=True)
        values = zlib.decompressobj().decompress(data, size + 1)
    except zlib.error as error:
        raise ValueError(f"mosaic: the map is damaged: {error}") from error
    if len(values) != size:
        raise ValueError(f"mosaic: expected a map of {size} pixels, got {len(values)}")
    return np.frombuffer(values, np.uint8).reshape(int(height), int(width))
