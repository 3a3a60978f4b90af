"""Sets of images, read from a folder or from an array in a file."""

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_image, positive_number, refuse_image_path, shown
from jotlight.errors import hide_warnings
from jotlight.formats.files.file_systems import explained, find_files, open_file_system
from jotlight.formats.files.safe_paths import check_inside
from jotlight.formats.npy.archives import read_npz
from jotlight.formats.npy.arrays import open_npy_array
from jotlight.formats.npy.description import find_description
from jotlight.formats.opening.locations import is_url
from jotlight.images.io import read_image
from jotlight.paths import as_path, pattern_advice
from jotlight.progress import Progress, check_progress, shown_progress
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.intensity_scale import warn_about_scale

ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".npy")
"""Endings of the file names in a folder that are read as images."""

_MAX_READING = 15
"""Largest level of 8-bit images that more likely are bits, or readings of up to 4 bits."""


def read_image_set(
    source: str | os.PathLike[str],
    *,
    key: str | None = None,
    white: float | None = None,
    first: int | None = None,
    max_intensity: float = 1.0,
    progress: Progress = False,
) -> tuple[list[str], list[npt.NDArray[np.float32]]]:
    """Return the names and the gray images of a set, sorted by name.

    Parameters
    ----------
    source : path
        A folder of images, whose colors are converted to gray; it may be a URL. Or a `.npy` or
        `.npz` file with an array (N, H, W).
    key : str, optional
        The name of the array in a `.npz`.
    white : float, optional
        The level that becomes intensity 1. Default: the full scale of 8-bit images and of 16-bit
        PNG, and 1 for floats. An array of other integers, or of 8 bits with levels of at most 15,
        requires it.
    first : int, optional
        Read only the first `first` images. Default: all.
    max_intensity : float
        Largest intensity of an estimate, S. Images that look like gray levels beside it are
        reported.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

    Raises
    ------
    OSError, ValueError
        If there are no images, one cannot be read, or the array is a capture that jotlight wrote;
        the message names it.
    """
    check_first(first)
    check_progress(progress)
    if is_url(source):
        with tempfile.TemporaryDirectory() as folder:
            _fetch_images(str(source), Path(folder))
            return read_image_set(
                folder,
                key=key,
                white=white,
                first=first,
                max_intensity=max_intensity,
                progress=progress,
            )
    source = as_path(source, 'read_image_set("photos")')
    if not source.exists():
        advice = pattern_advice(source, "name the folder of the images")
        raise FileNotFoundError(f"there is no folder or file {source}{advice}")
    if not source.is_dir():
        names, stack = _read_stack(source, key, white, first)
        warn_about_scale(str(source), stack, max_intensity, is_file=True)
        return names, stack
    if key is not None:
        raise ValueError(f"key: names an array in a .npz, but {source} is a folder")
    paths = sorted(path for path in source.iterdir() if path.suffix.lower() in ENDINGS)
    paths = [path for path in paths if not path.name.startswith(".")][:first]
    if not paths:
        inner = next((path for path in sorted(source.iterdir()) if path.is_dir()), None)
        advice = "" if inner is None else f"; folders inside are not read, so pass one: {inner}"
        raise ValueError(f"{source}: expected images ({', '.join(ENDINGS)}), found none{advice}")
    images = []
    with shown_progress(progress, "reading images") as update:
        for number, path in enumerate(paths):
            image = read_image(check_inside(path, source), white=white, gray=True)
            if image.ndim != 2 or image.size == 0:
                raise ValueError(f"{path}: expected a gray or RGB image, got shape {image.shape}")
            images.append(np.ascontiguousarray(as_image(image, str(path)), np.float32))
            warn_about_scale(str(path), images[-1:], max_intensity, is_file=True)
            update((number + 1) / len(paths))
    return [path.name for path in paths], images


def require_gray_stack(name: str, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless a shape is (N, H, W). The message says how to convert others.

    An array whose last axis has three or four values is taken for color.

    Examples
    --------
    >>> require_gray_stack("images", (400, 600, 3))
    Traceback (most recent call last):
      ...
    ValueError: images: expected gray images (N, H, W), got shape (400, 600, 3); colors are ...
    """
    is_color = len(shape) > 2 and shape[-1] in (3, 4) and min(shape[-3:-1]) > 4
    if len(shape) == 3 and not is_color:
        return
    if is_color:
        advice = "; colors are images of their own: write np.moveaxis(array, -1, 0)"
        advice += ".reshape(-1, *array.shape[1:3])" if len(shape) == 4 else ""
    elif len(shape) == 4:
        advice = "; channels are images of their own: write array.reshape(-1, *array.shape[2:])"
    else:
        advice = "; for a single image, write array[None]" if len(shape) == 2 else ""
    raise ValueError(f"{name}: expected gray images (N, H, W), got shape {shape}{advice}")


def check_first(first: int | None) -> None:
    """Raise ValueError unless `first` is None or at least 1."""
    if first is not None and first < 1:
        raise ValueError(f"first: expected at least 1 image, got {first}")


def _read_stack(
    source: Path, key: str | None, white: float | None, first: int | None
) -> tuple[list[str], list[npt.NDArray[np.float32]]]:
    suffix = source.suffix.lower()
    if suffix not in (".npy", ".npz"):
        raise ValueError(f"{source}: expected a folder of images, a .npy, or a .npz")
    if suffix == ".npy" and key is not None:
        raise ValueError(f"key: names an array in a .npz, but {source} is a .npy")
    if suffix == ".npy":
        _refuse_capture(source)
    array = read_npz(source, key) if suffix == ".npz" else open_npy_array(source)
    require_gray_stack(str(source), array.shape)
    if array.size == 0 or array.dtype.kind not in "uif":
        raise ValueError(
            f"{source}: expected a numeric array of gray images (N, H, W), got {array.dtype} of "
            f"shape {array.shape}"
        )
    array = array[:first]
    if white is None:
        _require_scale(source, array)
        white = 255.0 if array.dtype == np.uint8 else 1.0
    else:
        white = positive_number("white", white)
    stack = (np.asarray(array) / np.float64(white)).astype(np.float32)
    as_image(stack, str(source))
    digits = len(str(len(array) - 1))
    names = [f"{number:0{digits}d}" for number in range(len(array))]
    return names, list(stack)


def _refuse_capture(source: Path) -> None:
    """Raise ValueError if the description beside an array states that it is a capture."""
    with hide_warnings():  # another program may have described the images
        description = find_description(source)
    if description is not None:
        raise ValueError(
            f"{source}: expected gray images (N, H, W), got {description.format}, according to "
            f"{description.path.name}; jotlight.open reads them in Python, and `jotlight "
            "reconstruct` estimates their image"
        )


def _require_scale(source: Path, array: npt.NDArray[Any] | Frames) -> None:
    """Raise ValueError unless the type and the values of an array show the level of white."""
    if array.dtype.kind == "f":
        return
    levels = ""
    if array.dtype == np.uint8:
        largest = int(np.max(np.asarray(array)))
        if largest > _MAX_READING or largest == 0:
            return
        levels = f" with values up to {largest}"
    raise ValueError(
        f"{source}: the scale of {array.dtype}{levels} is unknown; state the level of intensity 1 "
        "with white= (--white); if it is a capture, jotlight.open reads it in Python, and "
        "`jotlight reconstruct` estimates its image"
    )


def _fetch_images(url: str, folder: Path) -> None:
    """Fetch the images of a folder at a URL, numbered in the order of their names."""
    fs, _ = open_file_system(url, None)
    names = [name for name, *_ in find_files(url) if name.lower().endswith(ENDINGS)]
    if not names:
        raise ValueError(f"{url}: expected a folder of images ({', '.join(ENDINGS)}), got none")
    for number, name in enumerate(names):
        with explained(name):
            fs.get_file(name, str(folder / f"{number:08}-{name.rpartition('/')[2]}"))


def require_image_list(images: object, name: str = "images") -> None:
    """Raise TypeError unless images are a sequence or an array. Messages call them `name`.

    Examples
    --------
    >>> require_image_list(None)
    Traceback (most recent call last):
      ...
    TypeError: images: expected an array (N, H, W) or a list of images, got None
    """
    refuse_image_path(name, images, "[jotlight.read_image(path, gray=True) for path in paths]")
    iterations = {"__iter__", "__getitem__"}.intersection(dir(images))
    if not (iterations and hasattr(images, "__len__")):
        raise TypeError(
            f"{name}: expected an array (N, H, W) or a list of images, got {shown(images)}"
        )
