"""Images and films of any kind of number, as files for display or for measurements."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import positive_number, refuse_data, refuse_masked, to_array, type_of
from jotlight.errors import warn
from jotlight.files import atomic_write
from jotlight.formats.capture import CountStack
from jotlight.images.clipping import Clipping
from jotlight.images.io import DISPLAYED, image_writer
from jotlight.images.tone import Exposure, Tone, expose, find_white
from jotlight.images.video import DEFAULT_FPS, is_floats, video_writer
from jotlight.layout import looks_like_color
from jotlight.paths import as_path
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings

_SEQUENCES = (Sequence, np.ndarray, Bits, CountStack, Readings)
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
        and `.npy` (the type of the image) for numbers, which are never clipped.
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
        When the image is exposed automatically, or negative values become black.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "ramp.png"
    >>> jl.save_image(path, np.linspace(0, 1, 12).reshape(3, 4))
    >>> path.stat().st_size > 50
    True
    """
    path = as_path(path, 'jotlight.save_image("a.png", image)')
    values = _checked(image, path.suffix.lower() in DISPLAYED)
    if path.suffix.lower() in DISPLAYED:
        white = find_white(values) if white is None else positive_number("white", white)
    write = image_writer(path, depth=depth, white=white or 1.0)
    if white is not None and path.suffix.lower() in DISPLAYED:
        _warn_of_negatives("image", values, white, depth)
    # An image can be computed again, so it need not survive a power failure.
    with atomic_write(path, durable=False) as temporary:
        write(temporary, values)


def _warn_of_negatives(name: str, values: npt.NDArray[Any], white: float, depth: int) -> bool:
    """Warn if values are below black by more than rounding to the levels of a file.

    Return whether there are such values.
    """
    number = np.count_nonzero(values < -0.5 * white / (2**depth - 1)) if values.min() < 0 else 0
    if number:
        warn(
            f"{name}: expected values of 0 or more for display, got {number} of {values.size} "
            f"below 0, down to {float(values.min()):.3g}, which are shown as black; add an offset, "
            "or write .tif, .exr, or .npy, which keep them"
        )
    return bool(number)


def save_film(
    path: str | os.PathLike[str],
    images: Iterable[npt.ArrayLike],
    *,
    fps: float = DEFAULT_FPS,
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
        Intensities, counts, or frames of bits or readings, such as those of :class:`jotlight.Bits`
        or of images of counts.
    fps : float
        Images per second of `.mp4` and `.gif`.
    white : float, optional
        The value that becomes white for display, as in :func:`save_image`. Default: that of the
        brightest image of a sequence or an array, which is read twice, or that of the first image
        of a generator. All images have the same white.
    depth : {8, 16}
        Bits per value. 16 are for a folder of `.png`.
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
        When the images are exposed automatically, or are brighter than the white of the first image
        of a generator. If a warning has stated this white, 5 % of the pixels of an image may be.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> bits = jl.Sensor(frames=12).expose(np.full((20, 30), 0.5), rng=0)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "film.gif"
    >>> jl.save_film(path, [part.counts() for part in bits.windows(4)], white=4)
    >>> path.stat().st_size > 100
    True
    """
    path = as_path(path, 'jotlight.save_film("a.gif", images)')
    tone = None if white is None else Tone("linear", positive_number("white", white))
    number = len(images) if isinstance(images, _SEQUENCES) else None
    is_displayed = not is_floats(path)
    _check_shape(images)
    clipping = None
    is_negative = False
    if tone is None and is_displayed:
        exposure, images = _exposed(images)
        exposure.report("images")
        # A warning about white announced that a few pixels of each image are brighter.
        clipping = Clipping(exposure.white, exposure.is_clipped)
        tone = Tone("linear", exposure.white)
    with (
        shown_progress(progress, f"writing {path.name}") as update,
        video_writer(path, number, tone=tone, fps=fps, depth=depth) as add,
    ):
        for index, image in enumerate(images):
            values = _checked(image, is_displayed)
            add(values.astype(np.float32))
            if clipping:
                clipping.count(values)
            if tone and is_displayed and not is_negative:
                name = f"images[{index}]"
                is_negative = _warn_of_negatives(name, values, tone.white, depth)
            if number:
                update((index + 1) / number)
    if clipping:
        clipping.report(", or pass a list of all images")


def _check_shape(images: Iterable[npt.ArrayLike]) -> None:
    """Raise TypeError or ValueError if the images are, or look like, a single image or object."""
    # The images of bits, readings, and lists are checked one after another.
    if not isinstance(images, Bits | Readings | list | tuple):
        refuse_data("images", images)
    shape = getattr(images, "shape", ())
    if len(shape) == 2:
        raise ValueError(
            f"images: expected a stack (N, H, W) or (N, H, W, 3), got one image of shape "
            f"{tuple(shape)}; pass a list, [image]"
        )
    if len(shape) == 3 and looks_like_color(shape) and not isinstance(images, Bits | Readings):
        raise ValueError(
            f"images: expected a stack (N, H, W) or (N, H, W, 3), but shape {tuple(shape)} looks "
            "like one color image; pass a list, [image], or list(images) if the images are narrow"
        )


def _checked(image: npt.ArrayLike, is_displayed: bool) -> npt.NDArray[Any]:
    """Return an image as an array (H, W) or (H, W, 3), or raise TypeError or ValueError.

    An image for display has finite values only.
    """
    refuse_masked("image", image, "pass image.filled(0), or another value for masked pixels")
    values = to_array("image", image)
    if values.dtype.kind not in "biuf":
        raise TypeError(f"image: expected an array of numbers, got {type_of(image, values)}")
    if values.ndim == 3 and values.shape[2] == 1:
        values = values[..., 0]
    if not (values.ndim == 2 or (values.ndim == 3 and values.shape[2] == 3)) or values.size == 0:
        advice = "; jotlight.save_film writes a stack of images" if values.ndim in (3, 4) else ""
        if looks_like_color(values.shape) and values.shape[-1] == 4:
            advice = "; if the fourth channel is transparency, pass image[..., :3]"
        if values.ndim == 3 and len(values) in (1, 3):
            advice += "; if the first axis holds channels, pass np.moveaxis(image, 0, -1)"
        raise ValueError(f"image: expected shape (H, W) or (H, W, 3), got {values.shape}{advice}")
    if is_displayed and not np.isfinite(values).all():
        raise ValueError("image: expected finite values, got NaN or infinity")
    return values


def _exposed(images: Iterable[npt.ArrayLike]) -> tuple[Exposure, Iterable[npt.ArrayLike]]:
    """Return how to show all images of a sequence or the first one of others, and all images."""
    if isinstance(images, Bits) and len(images) > 0:
        return Exposure(True, 1.0, False), images
    if isinstance(images, _SEQUENCES):
        exposures = (expose(_checked(image, True)) for image in images)
        exposure = max(exposures, default=None)
    else:
        iterator: Iterator[npt.ArrayLike] = iter(images)
        first = next(iterator, None)
        exposure = None if first is None else expose(_checked(first, True))
        images = itertools.chain([] if first is None else [first], iterator)
    if exposure is None:
        raise ValueError("images: expected at least one, got none")
    return exposure, images
