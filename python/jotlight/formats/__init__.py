"""Camera data in files: one module or folder per family of captures.

``registry`` lists all formats, and ``format`` says what a format consists of. ``capture`` is what
a reader returns. Then

- ``swissspad``, ``spad512s``, ``visionsim``, and the folders ``npy``, ``hdf5``, ``matlab``,
  ``images``, and ``zarr`` each read and write one family. ``raw`` helps those without a header,
  and ``stated_layout`` reads all others without one;
- ``reading`` is `jotlight.open`, ``writing`` is `jotlight.save`, and ``verification`` detects
  changes of a file since jotlight wrote it.

The folders, each of which imports only those before it, and some of the modules above:

- ``files``: parts of files, at paths and URLs, and also from untrusted sources.
- ``frames``: the frames and counts of a file, its label, and how they are read.
- ``npy``, ``hdf5``, ``matlab``, ``images``, ``zarr``: the families above.
- ``opening``: how a capture is found and opened.
"""

from jotlight.formats.reading import open, open_capture
from jotlight.formats.registry import FORMATS
from jotlight.formats.verification import verify_capture
from jotlight.formats.writing import save

__all__ = ["FORMATS", "open", "open_capture", "save", "verify_capture"]


def __dir__() -> list[str]:
    return __all__
