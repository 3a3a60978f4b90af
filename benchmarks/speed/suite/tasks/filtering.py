"""The 15 x 15 filter of the second layer."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import jotlight as jl
import jotlight._engine as engine
from suite.case import Case, Rival, relative_difference
from suite.tasks.scene import HEIGHT, PIXELS, WIDTH

TAPS = 15
ONE_TAP = "jotlight, with a filter of one tap"
OPENCV, TORCH = "OpenCV, filter2D", "PyTorch, conv2d"
FOURIER, NDIMAGE = "SciPy, oaconvolve", "SciPy, ndimage.convolve"


def cases(quick: bool) -> Iterator[Case]:
    rng = np.random.default_rng(0)
    image = rng.random((HEIGHT, WIDTH), np.float32)
    taps = rng.random((TAPS, TAPS), np.float32)
    taps /= taps.sum()

    yield Case(
        name="filter",
        title="Filter",
        description=f"15 × 15 taps, mirrored at the border, {WIDTH} × {HEIGHT} pixels. jotlight "
        "runs a "
        "whole forward pass, with two splines that are the identity.",
        items=PIXELS,
        unit="pixels",
        run=forward(image, taps),
        rivals=[
            Rival(OPENCV, lambda cv2: opencv_filter(cv2, image, taps), "cv2"),
            Rival(TORCH, lambda torch: torch_filter(torch, image, taps), "torch"),
            Rival(FOURIER, lambda signal: fourier_filter(signal, image, taps), "scipy.signal"),
            Rival(NDIMAGE, lambda nd: ndimage_filter(nd, image, taps), "scipy.ndimage"),
        ],
        difference=relative_difference,
        agreement="largest difference relative to the largest value",
        tolerance=1e-5,
        operations=TAPS**2 * PIXELS,
        bytes=8 * PIXELS,
        operations_note="225 multiply-adds per pixel, without those of the splines",
        parts={ONE_TAP: forward(image, np.ones((1, 1), np.float32))},
    )


def forward(image: np.ndarray, taps: np.ndarray) -> Callable[[int], np.ndarray]:
    layers = [identity_layer(np.ones((1, 1), np.float32)), identity_layer(taps)]
    prepared = [layer.engine_layer for layer in layers]

    def run(threads: int) -> np.ndarray:
        out = np.empty_like(image)
        engine.forward(prepared, [image[None]], [out], threads)
        return out

    return run


def identity_layer(taps: np.ndarray) -> jl.Layer:
    """Return a layer whose spline is φ(z) = z on [0, 1]."""
    return jl.Layer(taps[None, None], np.array([[-1.0, 0.0, 1.0, 2.0]], np.float32), 0.0, 1.0)


def opencv_filter(cv2: Any, image: np.ndarray, taps: np.ndarray) -> Callable[[], np.ndarray]:
    flipped = np.ascontiguousarray(taps[::-1, ::-1])
    return lambda: cv2.filter2D(image, cv2.CV_32F, flipped, borderType=cv2.BORDER_REFLECT)


def torch_filter(torch: Any, image: np.ndarray, taps: np.ndarray) -> Callable[[], np.ndarray]:
    flipped = torch.from_numpy(taps[::-1, ::-1].copy())[None, None]

    def run() -> np.ndarray:
        padded = torch.from_numpy(np.pad(image, TAPS // 2, mode="symmetric"))[None, None]
        return torch.nn.functional.conv2d(padded, flipped)[0, 0].numpy()

    return run


def fourier_filter(signal: Any, image: np.ndarray, taps: np.ndarray) -> Callable[[], np.ndarray]:
    def run() -> np.ndarray:
        padded = np.pad(image, TAPS // 2, mode="symmetric")
        return signal.oaconvolve(padded, taps, mode="valid")

    return run


def ndimage_filter(nd: Any, image: np.ndarray, taps: np.ndarray) -> Callable[[], np.ndarray]:
    return lambda: nd.convolve(image, taps, mode="reflect")
