"""Previews of bits: images of how often each pixel is one, for people to look at."""

import importlib
from typing import Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from jotlight.notebook import card, normalize
from jotlight.sensing.bits.frames import Frames, frames_within
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.sensor_like import SensorLike
from jotlight.sensing.parameters.slices import frames_text

MAX_BYTES = 1 << 26
"""Maximum number of bytes of bits that a preview reads."""


_SIDE = 384
"""Shorter side of the image of a table in a notebook, in pixels, before it is reduced further."""


class BitsLike(Protocol):
    """The part of :class:`jotlight.Bits` that a preview uses."""

    packed: npt.NDArray[np.uint8] | Frames
    sensor: SensorLike | None
    provenance: Provenance | None

    @property
    def shape(self) -> tuple[int, ...]: ...  # noqa: D102
    def __len__(self) -> int: ...
    def __getitem__(self, frames: slice) -> Self: ...
    def counts(self, oversampling: int) -> npt.NDArray[np.int32]: ...  # noqa: D102


def preview(
    bits: BitsLike, max_bytes: int = MAX_BYTES, max_side: int | None = None
) -> tuple[npt.NDArray[np.floating], range]:
    """Return an image from 0 to 1, and the frames that it shows: the first ones.

    A single frame is shown as it is. Of several frames, each pixel shows the fraction of ones, and
    white is the 99.5th percentile. Three channels are shown as colors, and others as their mean.

    Parameters
    ----------
    bits : Bits
        The bits.
    max_bytes : int
        Maximum number of bytes to read, unless one frame has more.
    max_side : int, optional
        Squares of pixels are averaged until the shorter side is at most about twice as long.
    """
    part = bits[: frames_within(bits.packed, max_bytes)]
    frames = range(len(part))
    side = part.sensor.oversampling if part.sensor else 1
    counts = part.counts(side)
    factor = max(1, min(counts.shape[:2]) // max_side) if max_side else 1
    height, width = (length // factor for length in counts.shape[:2])
    counts = counts[: height * factor, : width * factor]
    squares = counts.reshape(height, factor, width, factor, *counts.shape[2:])
    image = squares.mean(axis=(1, 3)) if factor > 1 else counts
    return normalize(image / (len(frames) * side**2)), frames


def html_of(bits: BitsLike) -> str:
    """Return HTML that describes bits, for notebooks."""
    frames, height, width, *channels = bits.shape
    image, shown = preview(bits, max_side=_SIDE)
    facts: dict[str, Any] = {"frames": frames, "jots": f"{height} x {width}"}
    if channels:
        facts["channels"] = channels[0]
    facts["size"] = f"{bits.packed.nbytes / 1e6:.3g} MB"
    if bits.sensor is not None:
        facts["sensor"] = bits.sensor
    if bits.provenance is not None:
        facts["file"] = bits.provenance
    facts["image"] = caption(shown, frames)
    return card("Bits", facts, image)


def caption(shown: range, frames: int) -> str:
    """Return what a preview shows.

    Examples
    --------
    >>> caption(range(1), 1), caption(range(16), 16), caption(range(16), 99)
    ('the only frame', 'how often each pixel is 1', 'how often each pixel is 1 in frames 0 to 15')
    >>> caption(range(1), 99)
    'how often each pixel is 1 in frame 0'
    """
    if frames == 1:
        return "the only frame"
    part = "" if len(shown) == frames else f" in {frames_text(shown)}"
    return f"how often each pixel is 1{part}"


def show(bits: BitsLike) -> None:
    """Show a preview of bits with matplotlib's pyplot."""
    image, shown = preview(bits)
    show_image(image, caption(shown, len(bits)))


def show_image(image: npt.NDArray[np.floating], title: str) -> None:
    """Show an image from 0 to 1 with matplotlib's pyplot."""
    import matplotlib.pyplot as plt

    _, axes = plt.subplots(layout="constrained")
    axes.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    axes.set(title=title, xticks=[], yticks=[])
    plt.show()


def open_viewer(data: object) -> None:
    """Open frames in napari or on the page of the viewer, both of which build on this package."""
    importlib.import_module("jotlight.napari.opening").open_viewer(data)
