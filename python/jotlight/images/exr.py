"""OpenEXR: float pictures as film and rendering tools take them."""

import json
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import MissingExtraError


def check_exr() -> None:
    """Raise MissingExtraError unless the package that writes EXR is installed."""
    if find_spec("OpenEXR") is None:
        raise MissingExtraError(
            "EXR files need the package OpenEXR, which is not installed: "
            "pip install 'jotlight[exr]'; .tif and .npy hold floats without it"
        )


def write_exr(path: Path, picture: npt.NDArray[Any], note: Mapping[str, Any] | None) -> None:
    """Write float32 without loss: the channel Y, or R, G and B; `note` as JSON in `comments`."""
    import OpenEXR

    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
    }
    if note:
        header["comments"] = json.dumps(dict(note))
    values = np.ascontiguousarray(picture, np.float32)
    OpenEXR.File(header, {"Y" if values.ndim == 2 else "RGB": values}).write(str(path))
