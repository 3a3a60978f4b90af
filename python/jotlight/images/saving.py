"""Images and films of any kind of number, as files for display or for measurements."""

import itertools
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_path
from jotlight.errors import warn
from jotlight.files import atomic_write
from jotlight.formats.capture import CountStack
from jotlight.images.io import DISPLAYED, image_writer
from jotlight.images.tone import PERCENTILE, Tone
from jotlight.images.video import is_floats, video_writer
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.bits import Bits

_DARK = 0.1
"""Images whose bright pixels are below this fraction of white are exposed automatically."""

_SEQUENCES = (Sequence, np.ndarray, Bits, CountStack)
"""Types of films with a known number of images."""


def save_image(
    path: str | os.PathLike[str],
    image: npt.ArrayLike,
    *,
    white: float | None = None,
    depth: int = 8,
) -> None:
    """Write an image to a file, completely or not at all.

    Parameters
    ----------
    path : path
        The ending chooses the format: `.png` and `.jpg` for display; `.tif` and `.exr` (float32)
        and `.npy` for numbers, which are never clipped.
    image : array_like, shape (H, W), (H, W, 1), or (H, W, 3)
        Intensities, counts, or one frame of bits.
    white : float, optional
        The value that becomes white in PNG and JPEG. Brighter pixels are white, too. Default: 1 for
        bool and floats, and the largest possible value of uint8 and uint16. Other integers, and
        images that exceed this value or are below a tenth of it, are exposed automatically, with a
        warning: white is about the 99.5th percentile.
    depth : {8, 16}
        Bits per value of a PNG.

    Raises
    ------
    TypeError, ValueError
        When the image, the name, or an option is not of the kind above.
    OSError
        When the file cannot be written.

    Warns
    -----
    JotlightWarning
        When the image is exposed automatically.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "ramp.png"
    >>> save_image(path, np.linspace(0, 1, 12).reshape(3, 4))
    >>> path.stat().st_size > 50
    True
    """
    path = as_path(path, 'jotlight.save_image("a.png", image)')
    if isinstance(image, Bits):
        raise TypeError(
            "image: expected an array, got Bits; take one frame, bits[0], or bits.counts()"
        )
    values = _checked(image, path.suffix.lower() in DISPLAYED)
    if path.suffix.lower() in DISPLAYED:
        white = find_white(values) if white is None else _checked_white(white)
    write = image_writer(path, depth=depth, white=white or 1.0)
    # An image can be computed again, so it need not survive a power failure.
    with atomic_write(path, durable=False) as temporary:
        write(temporary, values)


def save_film(
    path: str | os.PathLike[str],
    images: Iterable[npt.ArrayLike],
    *,
    fps: float = 25.0,
    white: float | None = None,
    depth: int = 8,
    progress: Progress = None,
) -> None:
    """Write images of one shape as a film, completely or not at all.

    One image at a time is in memory.

    Parameters
    ----------
    path : path
        The ending chooses the format: `.mp4` (needs the package imageio-ffmpeg), `.gif`, or no
        ending, for a new folder of `.png`, for display; `.npy` and `.tif`, a stack of float32, for
        numbers, which are never clipped.
    images : iterable of array_like, shape (H, W), (H, W, 1), or (H, W, 3)
        Intensities, counts, or frames of bits, such as those of :class:`jotlight.Bits` or of images
        of counts.
    fps : float
        Images per second of `.mp4` and `.gif`.
    white : float, optional
        The value that becomes white for display, as in :func:`save_image`. Default: that of the
        first image, or of the first, the middle, and the last one of a sequence. All images have
        the same white.
    depth : {8, 16}
        Bits per value of a PNG.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called with the completed fraction, if
        the number of images is known. Default: a bar in notebooks.

    Raises
    ------
    TypeError, ValueError
        When the images, the name, or an option is not of the kind above, or there is no image.
    OSError
        When the file cannot be written.

    Warns
    -----
    JotlightWarning
        When the images are exposed automatically.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from jotlight import Sensor
    >>> bits = Sensor(frames=12).expose(np.full((20, 30), 0.5), rng=0)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "film.gif"
    >>> save_film(path, [part.counts() for part in bits.windows(4)], white=4)
    >>> path.stat().st_size > 100
    True
    """
    path = as_path(path, 'jotlight.save_film("a.gif", images)')
    tone = None if white is None else Tone("linear", _checked_white(white))
    number = len(images) if isinstance(images, _SEQUENCES) else None
    is_displayed = not is_floats(path)
    if tone is None and is_displayed:
        samples, images = _samples(images)
        together = np.concatenate([sample.ravel() for sample in samples])
        tone = Tone("linear", find_white(together, "images"))
    with (
        shown_progress(progress, f"writing {path.name}") as update,
        video_writer(path, number, tone=tone, fps=fps, depth=depth) as add,
    ):
        for index, image in enumerate(images):
            add(_checked(image, is_displayed).astype(np.float32))
            if number:
                update((index + 1) / number)


def _samples(
    images: Iterable[npt.ArrayLike],
) -> tuple[list[npt.NDArray[Any]], Iterable[npt.ArrayLike]]:
    """Return some images that stand for all, and all images."""
    if isinstance(images, _SEQUENCES) and len(images) > 0:
        places = sorted({0, len(images) // 2, len(images) - 1})
        return [_checked(images[place], True) for place in places], images
    iterator: Iterator[npt.ArrayLike] = iter(images)
    first = next(iterator, None)
    if first is None:
        raise ValueError("images: expected at least one, got none")
    return [_checked(first, True)], itertools.chain([first], iterator)


def _checked(image: npt.ArrayLike, is_displayed: bool) -> npt.NDArray[Any]:
    """Return an image as an array (H, W) or (H, W, 3), or raise TypeError or ValueError.

    An image for display has finite values only.
    """
    values = np.asarray(image)
    if values.dtype.kind not in "biuf":
        raise TypeError(f"image: expected an array of numbers, got {values.dtype}")
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if not (values.ndim == 2 or (values.ndim == 3 and values.shape[2] == 3)) or values.size == 0:
        raise ValueError(f"image: expected shape (H, W) or (H, W, 3), got {values.shape}")
    if is_displayed and not np.isfinite(values).all():
        raise ValueError("image: expected finite values, got NaN or infinity")
    return values


def _checked_white(white: float) -> float:
    if not 0 < white < np.inf:
        raise ValueError(f"white: expected a finite value above 0, got {white}")
    return white


def find_white(values: npt.NDArray[Any], name: str = "image") -> float:
    """Return the value that :func:`save_image` shows as white if none is given.

    A warning about `name` states it, if it is not the full scale.

    Examples
    --------
    >>> find_white(np.array([[0.2, 0.9]])), find_white(np.full((2, 2), 99, np.uint8))
    (1.0, 255.0)
    """
    if values.dtype == np.bool_:
        return 1.0
    full = float(np.iinfo(values.dtype).max) if values.dtype in (np.uint8, np.uint16) else 1.0
    largest, has_scale = float(values.max()), values.dtype.kind == "f" or full > 1
    # In most images, counting the bright pixels suffices, which is faster than the percentile.
    limit = math.ceil(_DARK * full) if full > 1 else _DARK  # whole, so that NumPy converts nothing
    number = np.count_nonzero(values > limit)
    if has_scale and largest <= full and number > (1 - PERCENTILE / 100) * values.size + 1:
        return full
    bright = float(np.percentile(values, PERCENTILE))
    if has_scale and largest <= full and bright >= _DARK * full:
        return full
    # A few bright pixels must not make an ordinary image brighter.
    white = max(bright, full) if has_scale and largest > full else bright
    if white <= 0:
        white = largest if largest > 0 else full
    percentile = f", the {PERCENTILE}th percentile," if white == bright else ""
    warn(f"{name}: {white:.3g}{percentile} is shown as white; white= (--white) sets another value")
    return white
