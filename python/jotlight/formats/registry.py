"""The list of all formats. A new format is one file or folder here, and one line below."""

from jotlight.formats.format import Format, Writer
from jotlight.formats.hdf5.captures import HDF5
from jotlight.formats.images.captures import PNG, TIFF
from jotlight.formats.matlab.captures import MATLAB
from jotlight.formats.npy.captures import NPY, NPY_GZ, NPZ
from jotlight.formats.spad512s import SPAD512S, SPAD512S_SPARSE
from jotlight.formats.stated_layout import RAW
from jotlight.formats.swissspad import SWISSSPAD2, SWISSSPAD2_FULL
from jotlight.formats.visionsim import VISIONSIM
from jotlight.formats.zarr.captures import ZARR

# Detection tries the formats in this order.
_ALL = (
    NPY,
    NPY_GZ,
    NPZ,
    VISIONSIM,
    ZARR,
    HDF5,
    MATLAB,
    SWISSSPAD2,
    SWISSSPAD2_FULL,
    SPAD512S,
    SPAD512S_SPARSE,
    RAW,
    PNG,
    TIFF,
)

FORMATS: dict[str, Format] = {format_.name: format_ for format_ in _ALL}
"""All formats by name."""

WRITERS: dict[str, Writer] = {
    format_.name: format_.writer for format_ in _ALL if format_.writer is not None
}
"""Writers of the formats that can be written, by the name of the format."""
