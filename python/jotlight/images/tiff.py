"""Images in TIFF files, as float32 or as the numbers of other programs."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.formats.files.limits import check_claimed_size
from jotlight.formats.images.tiff_directories import move_samples_last, open_checked_tiff
from jotlight.formats.images.tiff_layout import ALPHA
from jotlight.formats.images.tiff_segments import check_segments
from jotlight.images.color import drop_transparency
from jotlight.output_files import OutputFile


def read_tiff(path: Path) -> tuple[npt.NDArray[Any], float | None]:
    """Return the values of an image, and the level of intensity 1 if it is known.

    Raises
    ------
    ValueError
        When the file claims more than it holds, or is damaged.
    """
    import tifffile

    try:
        with open_checked_tiff(path) as file:
            series = file.series[0]
            size = series.size * series.dtype.itemsize
            check_claimed_size("the header", size, path.stat().st_size, frame_bytes=size)
            for page in filter(None, series.pages):
                check_segments(file, page)
            array = move_samples_last(np.asarray(series.asarray()), series.axes)
            has_samples = "S" in series.axes
            has_alpha = bool(set(ALPHA) & set(series.keyframe.extrasamples))
            # Some programs do not mark the transparency of colors.
            has_alpha |= series.keyframe.photometric == tifffile.PHOTOMETRIC.RGB
    except Exception as error:  # any type: tifffile does not check what it reads
        raise ValueError(f"{path}: the TIFF file cannot be read ({error})") from error
    if has_alpha and has_samples and array.shape[-1] in (2, 4):
        array = drop_transparency(path, array)
        array = array[..., 0] if array.shape[-1] == 1 else array
    return array, 255.0 if array.dtype == np.uint8 else None


def write_tiff(file: OutputFile, image: npt.NDArray[Any], note: Mapping[str, Any] | None) -> None:
    """Write an image (H, W) or (H, W, C) as float32, with `note` as JSON in its description."""
    import tifffile

    options: dict[str, Any] = {}
    if note:
        options = {"description": json.dumps(dict(note)), "metadata": None}
    tifffile.imwrite(file, image.astype(np.float32), **kind_of(image), **options)


def kind_of(image: npt.NDArray[Any]) -> dict[str, Any]:
    """Return the options of tifffile for the channels of an image (H, W) or (H, W, C).

    Examples
    --------
    >>> kind_of(np.zeros((4, 6))), kind_of(np.zeros((4, 6, 3)))["photometric"]
    ({'photometric': 'minisblack'}, 'rgb')
    """
    if image.ndim == 2:
        return {"photometric": "minisblack"}
    kind = "rgb" if image.shape[2] == 3 else "minisblack"
    return {"photometric": kind, "planarconfig": "contig"}
