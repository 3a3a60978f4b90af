"""Warnings of the library, collected in the thread that issues them and shown on the page."""

import contextlib
import threading
import warnings
from collections.abc import Iterator

from jotlight.errors import JotlightWarning

_MAX_NOTES = 8
"""Maximum number of warnings that are kept of one computation."""

_local = threading.local()


@contextlib.contextmanager
def shown_warnings() -> Iterator[None]:
    """While the block runs, give each warning to the computation of its thread, if any.

    Warnings of other threads are shown as before. The filters of warnings belong to the whole
    process, so this is entered once, before any thread computes.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("always", JotlightWarning)
        before = warnings.showwarning

        def show(message, category, filename, lineno, file=None, line=None):  # type: ignore[no-untyped-def]
            texts = getattr(_local, "texts", None)
            if texts is None or not issubclass(category, JotlightWarning):
                before(message, category, filename, lineno, file, line)
            elif len(texts) < _MAX_NOTES and str(message) not in texts:
                texts.append(str(message))

        warnings.showwarning = show
        yield


@contextlib.contextmanager
def collected() -> Iterator[list[str]]:
    """Yield a list to which the warnings of this thread are added while the block runs."""
    texts: list[str] = []
    _local.texts = texts
    try:
        yield texts
    finally:
        _local.texts = None
