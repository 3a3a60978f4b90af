"""Several images of one scene in one file, each with its name."""

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Planes = Mapping[str, npt.NDArray[Any]]

ENDINGS = (".npz", ".npy", ".tif", ".tiff")


def stack_writer(
    path: str | os.PathLike[str], note: Mapping[str, Any] | None = None
) -> Callable[[Path, Planes], None]:
    """Find how to write named images of one shape to `path`, before they are made.

    `.npz` keeps each under its name; `.npy` is one float32 array (N, H, W) or (N, H, W, C) in
    their order, and `.tif` has a float32 page for each, with names and `note` as JSON in its
    ImageDescription.

    Raises
    ------
    ValueError
        For an unknown ending.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in ENDINGS:
        raise ValueError(
            f"{path}: expected a name that ends in {', '.join(ENDINGS[:3])} for several images, "
            f"got {suffix or 'none'}"
        )

    def write(file: Path, planes: Planes) -> None:
        if suffix == ".npz":
            with file.open("wb") as handle:
                np.savez_compressed(handle, **planes)  # type: ignore[arg-type]
            return
        stack = np.stack([plane.astype(np.float32) for plane in planes.values()])
        if suffix == ".npy":
            with file.open("wb") as handle:
                np.save(handle, stack)
            return
        import tifffile

        tifffile.imwrite(
            file,
            stack,
            photometric="rgb" if stack.ndim == 4 and stack.shape[3] == 3 else "minisblack",
            description=json.dumps({**(note or {}), "pages": list(planes)}),
            metadata=None,
        )

    return write
