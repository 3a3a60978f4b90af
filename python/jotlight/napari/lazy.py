"""Layers of napari whose images are computed when they are viewed."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.chunks import windows
from jotlight.estimators.demosaicing import COLORS
from jotlight.sensing.data.alike_frames import check_cycles
from jotlight.sensing.merged import Merged
from jotlight.view.estimate import estimate
from jotlight.view.running_counts import RunningCounts
from jotlight.view.state import COUNTS
from jotlight.view.viewed import Viewable, whole_cycles

if TYPE_CHECKING:
    import dask.array

KEY = "jotlight"
"""Key of a layer's metadata that holds its capture, as a :class:`LayerSource`."""

INTENSITIES = "jotlight intensities"
"""Key of a color layer's metadata that holds its intensities, because its data are clipped."""

LayerData = tuple[Any, dict[str, Any], str]
"""Data, arguments, and type of a layer, as napari's readers return it."""

_WINDOW = 64
"""Number of frames of an image of a new layer."""


class LayerSource:
    """The capture behind a layer, and the window of each of its images.

    Parameters
    ----------
    viewed : Viewable
        The capture.
    window : int
        Number of frames of an image, whole cycles of exposures.
    step : int
        Frames from one window to the next, whole cycles of exposures.
    method : str
        A key of ``METHODS``, "network-color", or "counts".
    """

    def __init__(self, viewed: Viewable, window: int, step: int, method: str) -> None:
        check_cycles(viewed.cycle, window, step)
        self.viewed, self.window, self.step, self.method = viewed, window, step, method
        self.spans = [
            range(part.start, part.stop) for part in windows(len(viewed.frames), window, step)
        ]
        """The frames of each image."""

    def image(self, index: int, merged: Merged | None = None) -> npt.NDArray[np.float32]:
        """Return an image of the layer, from the bits along the motion if these are passed."""
        span = self.spans[index]
        # Each call counts its own window, because dask may call from several threads.
        counts = RunningCounts(self.viewed).move(span)
        return estimate(self.viewed, span, self.method, counts, merged).image

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W) or (H, W, C): the shape of an image. Estimates of a mosaic have three colors."""
        has_mosaic = self.viewed.sensor(self.window).mosaic is not None
        colors = (COLORS,) if has_mosaic and self.method != COUNTS else ()
        return *self.viewed.shape, *colors

    def images(self) -> "dask.array.Array":
        """Return all images, (N, H, W) or (N, H, W, C), each computed when it is viewed."""
        import dask.array as da

        def compute(block_info: Any = None) -> npt.NDArray[np.float32]:
            index = block_info[None]["chunk-location"][0]
            return self.image(index)[None]

        chunks = ((1,) * len(self.spans), *((size,) for size in self.shape))
        return da.map_blocks(compute, chunks=chunks, dtype=np.float32, meta=np.empty(0, np.float32))


def make_layer(
    viewed: Viewable, window: int | None = None, step: int | None = None, method: str = "mle"
) -> LayerData:
    """Return a layer with an image of each window of a capture.

    Parameters
    ----------
    viewed : Viewable
        The capture.
    window : int, optional
        Number of frames of an image. Default: 64, or all frames if there are fewer. Of a bracket,
        whole cycles of exposures.
    step : int, optional
        Frames from one window to the next. Default: the size of a window.
    method : str
        A key of ``METHODS``, "network-color", or "counts". Except for counts, a mosaic becomes red,
        green, and blue.

    Returns
    -------
    tuple
        Data, arguments, and type of the layer. Only the first image is computed, for the contrast.

    Raises
    ------
    ValueError
        When the window or the step does not fit the capture or is not whole cycles of exposures,
        or the method does not serve the sensor.
    """
    if window is None:
        window = whole_cycles(viewed, min(_WINDOW, len(viewed.frames)))
    source = LayerSource(viewed, window, window if step is None else step, method)
    name = f"{viewed.title}, {method}"
    return display_layer(source.images(), source.image(0), name, {KEY: source})


def display_layer(
    images: Any,
    first: npt.NDArray[np.float32],
    name: str,
    metadata: dict[str, Any] | None = None,
) -> LayerData:
    """Return a layer of intensities, whose white is the 99.5th percentile of its first image.

    napari shows three channels as colors from 0 to 1. Other channels get a slider.

    Parameters
    ----------
    images : ndarray or dask.array.Array, shape (H, W), (N, H, W), (H, W, C), or (N, H, W, C)
        The intensities.
    first : ndarray, shape (H, W) or (H, W, C)
        The first of the images.
    name : str
        The name of the layer.
    metadata : dict, optional
        The metadata of the layer.

    Examples
    --------
    >>> image = np.full((2, 3, 3), 5.0, np.float32)
    >>> data, arguments, _ = display_layer(image, image, "gray patch")
    >>> float(data.max()), float(arguments["metadata"][INTENSITIES].max())
    (1.0, 5.0)
    """
    white = float(np.percentile(first, 99.5)) or 1.0
    metadata = dict(metadata or {})
    arguments: dict[str, Any] = {"name": name, "metadata": metadata}
    if first.shape[2:] == (3,):
        metadata[INTENSITIES] = images
        arguments["rgb"] = True
        return (images / white).clip(0, 1), arguments, "image"
    if first.ndim == 3:
        axes = list(range(images.ndim))
        images = images.transpose(*axes[:-3], axes[-1], *axes[-3:-1])
    arguments["contrast_limits"] = (0.0, white)
    return images, arguments, "image"


def source_of(layer: Any) -> LayerSource:
    """Return the capture behind a layer.

    Raises
    ------
    ValueError
        When the layer is not one of jotlight.
    """
    source = getattr(layer, "metadata", {}).get(KEY) if layer is not None else None
    if not isinstance(source, LayerSource):
        raise ValueError(
            "layer: expected one that jotlight made; open a capture with File > Open with Plugin"
        )
    return source


Reader = Callable[[Any], list[LayerData]]
