"""The 15 x 15 filter of the second layer."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import jotlight as jl
import jotlight._engine as engine
from suite.case import Case, Rival, largest
from suite.paths.scene import HEIGHT, PIXELS, WIDTH

TAPS = 15
WITHOUT = "jotlight, with a filter of one tap"


def cases(quick: bool) -> Iterator[Case]:
    rng = np.random.default_rng(0)
    image = rng.random((HEIGHT, WIDTH), np.float32)
    taps = rng.random((TAPS, TAPS), np.float32)
    taps /= taps.sum()

    yield Case(
        name="filter",
        title="Filter",
        words=f"15 × 15 taps, mirrored at the rim, {WIDTH} × {HEIGHT} pixels. Ours is a whole "
        "forward pass, with two splines that give what they are given; the time of one with a "
        "single tap is taken off where the filter alone is meant.",
        items=PIXELS,
        unit="pixels",
        ours=forward(image, taps),
        rivals=[
            Rival("OpenCV, filter2D", lambda cv2: opencv(cv2, image, taps), "cv2"),
            Rival("PyTorch, conv2d", lambda torch: of_torch(torch, image, taps), "torch"),
            Rival(
                "SciPy, oaconvolve", lambda signal: by_fourier(signal, image, taps), "scipy.signal"
            ),
            Rival(
                "SciPy, ndimage.convolve", lambda nd: by_ndimage(nd, image, taps), "scipy.ndimage"
            ),
        ],
        difference=largest,
        agreement="largest difference relative to the largest value",
        tolerance=1e-5,
        slots=TAPS**2 * PIXELS,
        bytes=8 * PIXELS,
        counted="225 multiply-adds a pixel, without those of the splines",
        parts={WITHOUT: forward(image, np.ones((1, 1), np.float32))},
    )


def forward(image: np.ndarray, taps: np.ndarray) -> Callable[[int], np.ndarray]:
    layers = [same_again(np.ones((1, 1), np.float32)), same_again(taps)]
    prepared = [layer.engine_layer for layer in layers]
    return lambda threads: engine.forward(prepared, image[None], threads)


def same_again(taps: np.ndarray) -> jl.Layer:
    """A layer whose spline is φ(z) = z on [0, 1]."""
    return jl.Layer(taps[None, None], np.array([[-1.0, 0.0, 1.0, 2.0]], np.float32), 0.0, 1.0)


def opencv(cv2: Any, image: np.ndarray, taps: np.ndarray) -> Callable[[], np.ndarray]:
    turned = np.ascontiguousarray(taps[::-1, ::-1])
    return lambda: cv2.filter2D(image, cv2.CV_32F, turned, borderType=cv2.BORDER_REFLECT)


def of_torch(torch: Any, image: np.ndarray, taps: np.ndarray) -> Callable[[], np.ndarray]:
    turned = torch.from_numpy(taps[::-1, ::-1].copy())[None, None]

    def run() -> np.ndarray:
        padded = torch.from_numpy(np.pad(image, TAPS // 2, mode="symmetric"))[None, None]
        return torch.nn.functional.conv2d(padded, turned)[0, 0].numpy()

    return run


def by_fourier(signal: Any, image: np.ndarray, taps: np.ndarray) -> Callable[[], np.ndarray]:
    def run() -> np.ndarray:
        padded = np.pad(image, TAPS // 2, mode="symmetric")
        return signal.oaconvolve(padded, taps, mode="valid")

    return run


def by_ndimage(nd: Any, image: np.ndarray, taps: np.ndarray) -> Callable[[], np.ndarray]:
    return lambda: nd.convolve(image, taps, mode="reflect")
