"""Checks of color mosaics: what their filters transmit, and the white balance."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Colors, Pattern
from jotlight.checks import shown, to_array
from jotlight.sensing.parameters import mosaic_text
from jotlight.sensing.parameters.maps import LIMITS

LETTERS = {
    "R": (1.0, 0.0, 0.0),
    "G": (0.0, 1.0, 0.0),
    "B": (0.0, 0.0, 1.0),
    "W": (1.0, 1.0, 1.0),
    "C": (0.0, 1.0, 1.0),
    "M": (1.0, 0.0, 1.0),
    "Y": (1.0, 1.0, 0.0),
}
"""The shares of red, green, and blue light that ideal filters pass."""

_MAX_SHOWN_LETTERS = 32
"""Largest length of a pattern that a message shows."""


def is_image(given: Any) -> bool:
    """Return whether a pattern is an image, (H, W, 3)."""
    return not isinstance(given, str) and to_array("mosaic", given).ndim == 3


def of_image(image: npt.NDArray[Any]) -> tuple[Pattern, Colors]:
    """Return the filter of each pixel of an image, and what the filters pass."""
    if image.dtype.kind != "f" or image.shape[2] != 3:
        raise ValueError(
            "mosaic: expected an image (H, W, 3) of numbers from 0 to 1, the shares of light that "
            f"pass, got {image.dtype} of shape {image.shape}; divide an 8-bit image by 255"
        )
    colors, places = np.unique(image.reshape(-1, 3), axis=0, return_inverse=True)
    mosaic_text.check_number(len(colors))
    return places.reshape(image.shape[:2]).astype(np.uint8), colors.astype(np.float64)


def letter_of(shares: list[float], index: int) -> str:
    """Return the letter of an ideal filter, or for another filter a, b, c, … by its index."""
    for letter, ideal in LETTERS.items():
        if tuple(shares) == ideal:
            return letter
    return chr(ord("a") + index)


def are_ideal(filters: str, transmission: Colors) -> bool:
    """Return whether the filters pass what their letters say."""
    return all(
        tuple(shares) == LETTERS.get(letter)
        for letter, shares in zip(filters, transmission.tolist(), strict=True)
    )


def _numbers(name: str, values: Any, example: str) -> Colors:
    """Return a new array of float64, or raise TypeError for other values than numbers."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(
            f"{name}: expected numbers such as {example}, got {shown(values)}"
        ) from error


def checked_transmission(transmission: Any, pattern: Pattern, filters: str) -> Colors:
    """Return the transmission of filters after checks. None stands for ideal filters."""
    if transmission is None:
        if filters.upper() != filters and not set(filters.upper()) - set(LETTERS):
            letters = mosaic_text.letters_of(pattern, filters)
            small = len(letters) <= _MAX_SHOWN_LETTERS
            such_as, got = (f", such as {letters.upper()}", letters) if small else ("", filters)
            raise ValueError(f"mosaic: expected capital letters{such_as}, got {got}")
        if unknown := sorted(set(filters) - set(LETTERS)):
            raise ValueError(
                f"mosaic: expected the letters {', '.join(LETTERS)}, got {', '.join(unknown)}; "
                "pass transmission, the shares of red, green, and blue light of each filter, too: "
                'Mosaic("ABCD", filters="ABCD", transmission=[[0.9, 0.1, 0.0], …])'
            )
        return np.array([LETTERS[letter] for letter in filters])
    matrix = _numbers("transmission", transmission, "[[0.9, 0.1, 0.0], …], a row a filter")
    if matrix.shape != (len(filters), 3):
        raise ValueError(
            f"transmission: expected shape {(len(filters), 3)}, the shares of red, green, and blue "
            f"light for each of the filters {filters}, got {matrix.shape}"
        )
    if not ((matrix >= 0) & (matrix <= 1)).all() or not (matrix.sum(axis=1) >= LIMITS[0]).all():
        raise ValueError(
            "transmission: expected numbers from 0 to 1, not all 0 for a filter, got "
            f"{matrix.tolist()}"
        )
    return matrix


def checked_white_balance(values: npt.ArrayLike) -> Colors:
    """Return three factors after checks."""
    factors = _numbers("white_balance", values, "[2.0, 1.0, 1.5]")
    if factors.shape != (3,):
        raise ValueError(
            "white_balance: expected three factors, of red, green, and blue, got shape "
            f"{factors.shape}; a fourth one, as in rawpy, is that of the second green: leave it out"
        )
    if not ((factors > 0) & (factors <= LIMITS[1])).all():
        raise ValueError(f"white_balance: expected numbers above 0, got {factors.tolist()}")
    return factors


def sort_filters(
    pattern: Pattern, filters: str, transmission: Colors
) -> tuple[Pattern, str, Colors]:
    """Return the same mosaic with its filters sorted, and with equal filters united."""
    rows = [
        (mosaic_text.rank(letter), tuple(shares))
        for letter, shares in zip(filters, transmission.tolist(), strict=True)
    ]
    distinct = sorted(set(rows))
    places = np.array([distinct.index(row) for row in rows], np.uint8)
    return (
        np.ascontiguousarray(places[pattern]),
        "".join(letter for (_, letter), _ in distinct),
        np.array([shares for _, shares in distinct]),
    )
