"""Warnings about images whose values are not intensities: levels of a file, and transparency."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn

MEANING = "most intensities should be at most max_intensity"
"""What the warning says in every case."""

_MARGIN = 10
"""Factor by which the intensities of a bright scene may exceed the largest of an estimate."""

_LEVELS = 255, 65535
"""Largest levels of images of integers."""


def warn_about_scale(
    name: str,
    images: Iterable[npt.NDArray[Any]],
    max_intensity: float,
    *,
    is_file: bool = False,
) -> None:
    """Warn about images that look like gray levels, since they are whole or almost all too bright.

    A light may be far brighter than the largest intensity of an estimate, S. But an estimate is
    wrong almost everywhere if most pixels exceed S. Above the levels of integers, an image is a
    saturated scene.

    Parameters
    ----------
    name : str
        Name of the argument, or path of the file.
    images : iterable of ndarray of float
        Checked intensities, at least one image.
    max_intensity : float
        S.
    is_file : bool
        Whether `name` is the path of a file, which is read with a white level.

    Examples
    --------
    >>> warn_about_scale("image", [np.array([0.5, 0.25, 200.3])], 1.0)  # a light: no warning
    """
    each = list(images)
    found = gray_levels(each, max_intensity)
    if found is None:
        return
    if found.are_whole:
        reason = f"they are whole numbers up to {found.highest:g}; for an integer image,"
    else:
        reason = (
            f"most of them exceed {_MARGIN * max_intensity:g}, up to {found.highest:.4g}; for a "
            "scene this bright, pass Sensor(max_intensity=…) (--max-intensity); for gray levels,"
        )
    advice = "pass white=" if is_file else f"write {name} / "
    advice += f"{found.level} (--white {found.level})"
    warn(f"{name}: {MEANING}={max_intensity:g}, but {reason} {advice}")


class GrayLevels(NamedTuple):
    """Why images look like gray levels."""

    highest: float
    """Their largest value."""

    level: int
    """The largest level of images of integers with such values."""

    are_whole: bool
    """Whether the values of the bright images are whole numbers. Otherwise most are too bright."""


def gray_levels(images: Sequence[npt.NDArray[Any]], max_intensity: float) -> GrayLevels | None:
    """Return why images look like gray levels, or None if they do not.

    Examples
    --------
    >>> gray_levels([np.array([0.0, 128.0])], 1.0)
    GrayLevels(highest=128.0, level=255, are_whole=True)
    """
    limit, highest = _MARGIN * max_intensity, max(float(image.max()) for image in images)
    level = next((level for level in _LEVELS if highest <= level), None)
    if highest <= limit or level is None:
        return None
    bright = [image for image in images if image.max() > limit]
    if all((image == np.rint(image)).all() for image in bright):
        return GrayLevels(highest, level, True)
    pixels = sum(image.size for image in images)
    is_bright = 2 * sum(np.count_nonzero(image > limit) for image in bright) > pixels
    return GrayLevels(highest, level, False) if is_bright else None


def warn_about_transparency(image: npt.NDArray[Any]) -> None:
    """Warn if the last of four channels of an image (..., H, W, 4) looks like transparency.

    That of an opaque image is 1 everywhere, and its colors are not.

    Examples
    --------
    >>> warn_about_transparency(np.ones((2, 3, 3)))
    """
    # In most images, the first pixel decides.
    if image.shape[-1] != 4 or image[..., 3].flat[0] != 1 or not (image[..., 3] == 1).all():
        return
    if not (image[..., :3] == 1).all():
        warn(
            "image: the last of its four channels is 1 everywhere, as the transparency of an "
            "opaque image is; if it holds no light, pass image[..., :3]"
        )
