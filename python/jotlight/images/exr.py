"""OpenEXR: float images for video and rendering tools."""

import json
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import MissingExtraError
from jotlight.output_files import described_error


def check_exr() -> None:
    """Raise MissingExtraError unless the package that writes EXR is installed."""
    if find_spec("OpenEXR") is None:
        raise MissingExtraError(
            "EXR files need the package OpenEXR, which is not installed: "
            "pip install 'jotlight[exr]'; .tif and .npy hold floats without it"
        )


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
