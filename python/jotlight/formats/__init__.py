"""Camera data in files: one module per family of captures.

``registry`` lists all formats, and ``format`` says what a format consists of. Then

* ``npy``, ``visionsim``, ``zarr``, ``hdf5``, ``matlab``, ``swissspad``, ``spad512s``, and
  ``image_files`` each read and write one family;
* ``detect`` finds the format of a file, ``reading`` opens it, and ``writing`` writes it;
* ``checksums`` and ``verification`` detect changes of a file since jotlight wrote it;
* ``capture``, ``selection``, ``orientation``, and ``packing`` handle what was read;
* ``cube``, ``description``, ``labels``, and ``labeled`` keep the width, sensor, and provenance;
* ``hdf5_library`` calls the HDF5 library, and ``isolated`` runs it in a child process;
* ``arrays``, ``archives``, ``compressed``, ``file_reader``, ``raw``, ``file_lists``, ``magic``,
  ``limits``, ``safe_paths``, ``mat_files``, ``mat_sizes``, ``png_chunks``, ``tiff_directories``,
  ``tiff_segments``, ``zarr_codecs``, ``zarr_manifest``, and ``zarr_store`` read bytes, and check
  files from untrusted sources.
"""

from jotlight.formats.reading import open, open_capture
from jotlight.formats.registry import FORMATS
from jotlight.formats.verification import verify_capture
from jotlight.formats.writing import save

__all__ = ["FORMATS", "open", "open_capture", "save", "verify_capture"]
