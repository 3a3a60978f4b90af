"""Warnings of the library, which the page shows as notes of the image that caused them."""

import contextlib
from collections.abc import Iterator

from jotlight.errors import record_warnings

_MAX_NOTES = 8
"""Maximum number of notes of one image."""


@contextlib.contextmanager
def collected() -> Iterator[list[str]]:
    """Yield a list that holds the different warnings of this thread after the block has run.

    Examples
    --------
    >>> from jotlight.errors import warn
    >>> with collected() as notes:
    ...     for _ in range(3):
    ...         warn("2 of 64 pixels have no valid bit")
    >>> notes
    ['2 of 64 pixels have no valid bit']
    """
    notes: list[str] = []
    with record_warnings() as messages:
        yield notes
    notes += list(dict.fromkeys(messages))[:_MAX_NOTES]
