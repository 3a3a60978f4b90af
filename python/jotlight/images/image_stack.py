"""Files that hold several named images of one scene."""

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.images.color import fit_channels
from jotlight.images.tiff import kind_of
from jotlight.output_files import open_output

NamedImages = Mapping[str, npt.NDArray[Any]]
"""Images by name, of the same shape: (H, W) or (H, W, C)."""

ENDINGS = (".npz", ".npy", ".tif", ".tiff")
"""Endings of the names of these files. The last two are the same format."""


def stack_writer(
    path: str | os.PathLike[str], note: Mapping[str, Any] | None = None
) -> Callable[[Path, NamedImages], None]:
    """Return a function ``write(file, images)`` that writes named images of one shape.

    The ending of `path` chooses the format. `.npz` stores each image under its name. `.npy` is one
    float32 array (N, H, W) or (N, H, W, C) in the order of the mapping. `.tif` has one float32
    page per image; its ImageDescription holds the names and `note` as JSON.

    Raises
    ------
    ValueError
        If the ending is unknown. Callers learn this before they compute any image.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in ENDINGS:
        raise ValueError(
            f"{path}: expected a name that ends in {', '.join(ENDINGS[:3])} for several images, "
            f"got {suffix or 'none'}"
        )

    def write(file: Path, images: NamedImages) -> None:
        if suffix == ".npz":
            with open_output(file) as handle:
                np.savez_compressed(handle, **images)  # type: ignore[arg-type]
            return
        fitted = [fit_channels(Path(path), image) for image in images.values()]
        stack = np.stack(fitted).astype(np.float32)
        if suffix == ".npy":
            with open_output(file) as handle:
                np.save(handle, stack)
            return
        import tifffile

        with open_output(file) as handle:
            tifffile.imwrite(
                handle,
                stack,
                **kind_of(stack[0]),
                description=json.dumps({**(note or {}), "pages": list(images)}),
                metadata=None,
            )

    return write
