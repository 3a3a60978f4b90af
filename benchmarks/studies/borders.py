"""The PSNR of a scene that moves: without the border, where light enters and leaves the view."""

from typing import Any

import numpy.typing as npt

import jotlight as jl

INNER = (slice(8, -8),) * 2
"""The rows and columns of an image (H, W) without its border."""


def psnr_inside(image: npt.NDArray[Any], truth: npt.NDArray[Any]) -> float:
    """Return the PSNR in dB of an image without its border, for a peak of 1."""
    return float(jl.metrics.psnr(image[INNER], truth[INNER], data_range=1.0))
