"""Small valid files of every family that jotlight reads, and the function that reads each.

Tests and the fuzzer damage these files. ``reader`` says what an entry consists of; ``captures``,
``images``, ``models``, and ``results`` hold the entries; ``encodings`` makes bytes of files.
"""

from examples.captures import CAPTURES
from examples.images import IMAGES
from examples.models import MODELS
from examples.reader import Reader, read_or_refused
from examples.results import RESULTS

READERS: dict[str, Reader] = {**CAPTURES, **IMAGES, **MODELS, **RESULTS}
"""All readers of files by a name of their own. A capture's reader has the name of its format."""

__all__ = ["READERS", "Reader", "read_or_refused"]
