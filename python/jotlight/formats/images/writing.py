"""Writing of counts to TIFF and PNG, and of readings of several bits to TIFF."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts
from jotlight.files import atomic_write
from jotlight.formats.files.checksums import append_checksum
from jotlight.formats.frames.labels import make_readings_label
from jotlight.output_files import open_output
from jotlight.sensing.bits.readings import Readings


def _smallest_type(counts: Counts) -> npt.NDArray[Any]:
    """Return counts in the smallest unsigned type that can represent them."""
    high = int(counts.max())
    return counts.astype(np.uint8 if high < 1 << 8 else np.uint16 if high < 1 << 16 else np.uint32)


def _without_single_channel(counts: Counts) -> Counts:
    """Return counts (H, W, 1) as (H, W), and others as they are."""
    return counts[..., 0] if counts.shape[2:] == (1,) else counts


def write_tiff(counts: Counts, path: Path, label: str | None) -> None:
    """Write counts as a TIFF, with their label as its description.

    Raises
    ------
    ValueError
        For two channels, which other programs would take for gray and transparency.
    """
    import tifffile

    with atomic_write(path) as temporary, open_output(temporary) as file:
        if counts.shape[2:] == (2,):
            raise ValueError(
                "tiff: expected one, three, or four channels, got 2; .npy, .h5, and .zarr hold two"
            )
        values = _without_single_channel(counts)
        tifffile.imwrite(
            file,
            _smallest_type(values),
            photometric="minisblack" if values.ndim == 2 else "rgb",
            metadata=None,
            description=label,
        )
        append_checksum(file)


def write_tiff_readings(readings: Readings, path: Path) -> None:
    """Write readings of several bits as a TIFF with a page for each frame."""
    import tifffile

    if readings.sensor.maps():
        raise ValueError(
            "tiff: has no place for the maps of a sensor; write to a name that ends in .npy to "
            "keep them"
        )
    kind = np.uint8 if readings.sensor.bit_depth <= 8 else np.uint16
    label = json.dumps(make_readings_label(readings.sensor, readings.provenance))
    with atomic_write(path) as temporary, open_output(temporary) as file:
        tifffile.imwrite(
            file,
            (readings[index].astype(kind) for index in range(len(readings))),
            shape=readings.shape,
            dtype=kind,
            photometric="minisblack" if len(readings.shape) == 3 else "rgb",
            metadata=None,
            description=label,
        )
        append_checksum(file)


def write_png(counts: Counts, path: Path, label: str | None) -> None:
    """Write counts as a grayscale PNG, which has no place for the label.

    Raises
    ------
    ValueError
        For several channels, and for counts that need more than 16 bits.
    """
    from PIL import Image

    with atomic_write(path) as temporary, open_output(temporary) as file:
        if counts.shape[2:] not in ((), (1,)):
            raise ValueError(
                f"png: expected counts of one channel, got {counts.shape[2]} channels; .npy, .h5, "
                "and .zarr hold several"
            )
        if counts.max() >= 1 << 16:
            raise ValueError(
                f"png: expected counts below 65536, got up to {counts.max()}; .tif holds them"
            )
        Image.fromarray(_smallest_type(_without_single_channel(counts))).save(file, "PNG")
