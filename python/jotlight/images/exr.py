"""OpenEXR: float images for video and rendering tools."""

import json
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import MissingExtraError
from jotlight.formats.files.limits import check_claimed_size
from jotlight.images.color import warn_about_transparent_pixels
from jotlight.output_files import described_error


def check_exr() -> None:
    """Raise MissingExtraError unless the package for EXR is installed."""
    if find_spec("OpenEXR") is None:
        raise MissingExtraError(
            "EXR files need the package OpenEXR, which is not installed: "
            "pip install 'jotlight[exr]'; .tif and .npy hold floats without it"
        )


def read_exr(path: Path) -> npt.NDArray[np.float32]:
    """Return the values of an image, (H, W) of channel Y or (H, W, 3) of R, G, and B.

    Raises
    ------
    MissingExtraError
        When the package OpenEXR is not installed.
    ValueError
        When the file has other channels, claims more than it holds, or is damaged.
    """
    check_exr()
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            if len(file.parts) != 1:
                raise ValueError(f"expected one image, got {len(file.parts)}")
            header = file.header()
            (left, top), (right, bottom) = (corner.tolist() for corner in header["dataWindow"])
            size = (right - left + 1) * (bottom - top + 1) * 4 * len(header["channels"])
            check_claimed_size("the header", size, path.stat().st_size, frame_bytes=size)
            names = {channel.name for channel in header["channels"]}
        if names not in ({"Y"}, {"Y", "A"}, {"R", "G", "B"}, {"R", "G", "B", "A"}):
            raise ValueError(f"expected the channel Y or R, G, and B, got {sorted(names)}")
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except Exception as error:  # any type: OpenEXR raises RuntimeError and others
        raise ValueError(f"{path}: the EXR file cannot be read ({error})") from error
    if "A" in names:
        warn_about_transparent_pixels(path, np.asarray(channels["A"], np.float32))
    if "Y" in names:
        return np.asarray(channels["Y"], np.float32)
    return np.stack([np.asarray(channels[name], np.float32) for name in "RGB"], axis=-1)


def read_exr_comments(path: Path) -> str:
    """Return the `comments` in the header of a file; empty if there are none."""
    import OpenEXR

    with OpenEXR.File(str(path), header_only=True) as file:
        return str(file.header().get("comments", ""))


def write_exr(path: Path, image: npt.NDArray[Any], note: Mapping[str, Any] | None) -> None:
    """Write an image (H, W) or (H, W, 3) as float32, with `note` as JSON in `comments`."""
    import OpenEXR

    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
    }
    if note:
        header["comments"] = json.dumps(dict(note))
    values = np.ascontiguousarray(image, np.float32)
    try:
        OpenEXR.File(header, {"Y" if values.ndim == 2 else "RGB": values}).write(str(path))
    except RuntimeError as error:
        raise described_error(str(error), path) from error
