"""Camera data in files: one module or folder per family of captures.

``registry`` lists all formats, and ``format`` says what a format consists of. Then

* ``npy``, ``visionsim``, ``swissspad``, ``spad512s``, and the folders ``zarr``, ``hdf5``,
  ``matlab``, and ``images`` each read and write one family;
* ``detect`` finds the format of a file, ``opening`` opens it as its ``reading_options`` state,
  ``reading`` returns it to the caller, ``scaled`` and ``with_mosaic`` add what the caller states
  about it, and ``writing`` writes it;
* ``checksums`` and ``verification`` detect changes of a file since jotlight wrote it;
* ``capture``, ``count_stacks``, ``selection``, ``orientation``, and ``packing`` handle what was
  read;
* ``cube``, ``description``, ``labels``, and ``labeled`` keep the width, sensor, and provenance;
* ``locations``, ``file_systems``, ``remote_files``, and ``remote`` open URLs and globs;
* ``checked_reading`` computes the checksum of frames while they are read;
* ``arrays``, ``archives``, ``compressed``, ``blocks``, ``file_reader``, ``raw``, and ``file_lists``
  read bytes, and ``locks`` protects what threads share;
* ``magic``, ``limits``, and ``safe_paths`` check files from untrusted sources.
"""

from jotlight.formats.reading import open, open_capture
from jotlight.formats.registry import FORMATS
from jotlight.formats.verification import verify_capture
from jotlight.formats.writing import save

__all__ = ["FORMATS", "open", "open_capture", "save", "verify_capture"]


def __dir__() -> list[str]:
    return __all__
