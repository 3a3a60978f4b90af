"""What a worker reports to the client: its warnings, and its address in errors of files."""

import contextlib
import sys
from collections.abc import Iterator
from typing import Any

from jotlight.errors import JotlightWarning, record_warnings


def _this_worker() -> Any:
    """Return the worker of a cluster that runs this task, or None for a thread of the caller."""
    distributed = sys.modules.get("distributed")
    try:
        return distributed and distributed.get_worker()
    except ValueError:
        return None


@contextlib.contextmanager
def naming_worker() -> Iterator[None]:
    """Add the worker to errors of files, which the machine of the client may have.

    Examples
    --------
    >>> with naming_worker():  # no worker
    ...     pass
    """
    try:
        yield
    except OSError as error:
        if (worker := _this_worker()) is not None:
            is_missing = isinstance(error, FileNotFoundError)
            advice = ", which must see all files under the same paths" if is_missing else ""
            error.add_note(f"on the worker {worker.address}{advice}")
        raise


@contextlib.contextmanager
def warning_client() -> Iterator[None]:
    """Issue the warnings of jotlight in the client if a worker runs the block.

    Examples
    --------
    >>> with warning_client():  # no worker
    ...     pass
    """
    if _this_worker() is None:
        yield
        return
    import distributed

    with record_warnings() as messages:
        yield
    for message in dict.fromkeys(messages):
        distributed.warn(message, JotlightWarning)
