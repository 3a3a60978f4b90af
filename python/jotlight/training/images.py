"""Training images: checks of arrays, and of functions that generate images."""

import hashlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_image
from jotlight.images.sets import require_gray_stack, require_image_list

ImageGenerator = Callable[[np.random.Generator, int], npt.NDArray[np.floating]]
"""A function of a random generator and a number N that returns N new images, (N, H, W)."""

Images = npt.NDArray[np.float32] | list[npt.NDArray[np.float32]]
"""Checked images: an array (N, H, W), or a list of arrays (H, W) of any size."""

TrainingImages = npt.NDArray[np.floating] | Sequence[npt.ArrayLike] | ImageGenerator
"""Images as a user passes them."""


def check_images(images: npt.ArrayLike | Sequence[npt.ArrayLike], name: str = "images") -> Images:
    """Return gray images of intensities as float32. Messages call them `name`.

    Raises
    ------
    TypeError, ValueError
        When there are no images, when an image is not two-dimensional, and when intensities are
        integers, negative, or not finite.

    Examples
    --------
    >>> check_images([np.zeros((3, 4)), np.ones((2, 2))])[1].dtype
    dtype('float32')
    """
    require_image_list(images, name)
    if isinstance(images, np.ndarray):
        require_gray_stack(name, images.shape)
    if len(images) == 0:  # type: ignore[arg-type]
        raise ValueError(f"{name}: expected at least one, got none")
    if isinstance(images, np.ndarray):
        # One tall image takes one check.
        tall = as_image(images.reshape(-1, images.shape[2]) if images.size else images, name)
        return np.require(tall, np.float32, ["C"]).reshape(images.shape)
    checked = []
    for index, image in enumerate(images):  # type: ignore[arg-type]
        array = as_image(image, f"{name}[{index}]")
        if array.ndim != 2:
            raise ValueError(
                f"{name}[{index}]: expected a gray image (H, W), got shape {array.shape}; "
                "networks treat color channels alike, so pass each channel as an image"
            )
        checked.append(np.require(array, np.float32, ["C"]))
    return checked


def generate_images(make: ImageGenerator, rng: np.random.Generator, number: int) -> Images:
    """Return `number` new images from a function, after checks.

    Raises
    ------
    TypeError, ValueError
        When the function returns something else, or another number of images.
    """
    made = make(rng, number)
    if not isinstance(made, np.ndarray) or made.ndim != 3 or len(made) != number:
        received = f"shape {made.shape}" if isinstance(made, np.ndarray) else type(made).__name__
        raise ValueError(
            f"images: expected the callable to return an array ({number}, H, W), got {received}"
        )
    return check_images(made)


def fingerprint_images(images: Images | ImageGenerator) -> str:
    """Return a digest that identifies images, or the name of a function that makes them."""
    if callable(images):
        return getattr(images, "__qualname__", type(images).__qualname__)
    digest = hashlib.sha256()
    for image in images:
        digest.update(repr(image.shape).encode())
        digest.update(np.ascontiguousarray(image).data)
    return digest.hexdigest()


def describe_smallest(images: Sequence[npt.NDArray[Any]] | npt.NDArray[Any]) -> str:
    """Return a sentence about the smallest image, for error messages about the patch size."""
    index = min(range(len(images)), key=lambda index: min(images[index].shape))
    height, width = images[index].shape
    return (
        f"The smallest image, number {index}, is {height} x {width}; leave out images that are "
        "too small"
    )
