"""Files of the image that the page shows: PNG of 16 bits, TIFF, and EXR."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from jotlight._engine import __version__
from jotlight.estimators.brightness import UNITS
from jotlight.images.exr import check_exr
from jotlight.images.io import image_writer
from jotlight.parameter_names import check_choice
from jotlight.view.display import display_difference, displayable, fit_white, tone_of
from jotlight.view.estimate import Estimate, estimate, merge_window
from jotlight.view.running_counts import RunningCounts
from jotlight.view.state import COUNTS, ViewState
from jotlight.view.viewed import Viewable

ENDINGS = {"png": "image/png", "tif": "image/tiff", "exr": "image/x-exr"}
"""Endings of files and their media types."""


def save_view(viewed: Viewable, state: ViewState, ending: str) -> bytes:
    """Return the content of a file with the image of a state.

    A PNG has 16 bits per value and the tone curve of the state. TIFF and EXR have the values of the
    estimate as float32, which are never clipped. Of a difference, they have its values, and a PNG
    has its colors. Two or four channels become their mean, as on the page.

    Parameters
    ----------
    viewed : Viewable
        The capture.
    state : ViewState
        What the page shows.
    ending : {"png", "tif", "exr"}
        The format.

    Raises
    ------
    ValueError
        For another ending, frames that are not available, or a method that does not serve the
        sensor.
    MissingExtraError
        If `exr` needs the package OpenEXR.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> from jotlight.view.viewed import Viewed
    >>> viewed = Viewed.from_data(Bits.from_array(np.ones((4, 2, 2), bool)))
    >>> save_view(viewed, ViewState(window=4), "png")[1:4]
    b'PNG'
    """
    check_choice("format", ending, ENDINGS)
    if ending == "exr":
        check_exr()
    if state.within(viewed.frames, viewed.cycle).span != state.span:
        frames, cycle = viewed.frames, viewed.cycle
        some = "some" if cycle == 1 else f"whole cycles of {cycle} frames"
        raise ValueError(
            f"frames: expected {some} of {frames.start} to {frames.stop - 1}, got {state.start} to "
            f"{state.span.stop - 1}; older frames of a live capture have left memory"
        )
    counts = RunningCounts(viewed).move(state.span)
    merged = None
    if state.align and state.method != COUNTS:
        merged = merge_window(viewed, state.span, state.method)
    made = estimate(viewed, state.span, state.method, counts, merged)
    other = None
    if state.compare is not None and state.method != COUNTS:
        other = estimate(viewed, state.span, state.compare, counts, merged)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"view.{ending}")
        depth = 16 if ending == "png" else 8
        write = image_writer(file, depth=depth, note=_note(viewed, state, made, other))
        write(file, _values(viewed, made, other, state, ending))
        return file.read_bytes()


def _values(
    viewed: Viewable, made: Estimate, other: Estimate | None, state: ViewState, ending: str
) -> Any:
    """Return the values to write: intensities, or for PNG values from 0 to 1."""
    if ending != "png":
        return displayable(made.image if other is None else made.image - other.image)
    white = fit_white(viewed, state.span, made) if state.white is None else state.white
    if other is not None:
        return display_difference(made, other, white).levels / np.float32(255)
    return tone_of(made, state, white)(displayable(made.image))


def _note(
    viewed: Viewable, state: ViewState, made: Estimate, other: Estimate | None
) -> dict[str, Any]:
    """Return the facts that a file of floats states about itself."""
    provenance = viewed.provenance
    return {
        "software": f"jotlight {__version__}",
        "units": made.counted.units if state.method == COUNTS else UNITS["intensity"],
        "method": made.title,
        "difference_to": None if other is None else other.title,
        "frames": [state.start, state.start + state.window],
        "sensor": {**made.sensor.scalars(), **dict.fromkeys(made.sensor.maps(), "a map")},
        "provenance": None if provenance is None else provenance.to_json(),
    }


def file_name(viewed: Viewable, state: ViewState, ending: str) -> str:
    """Return a name for a file, of letters and digits that every system accepts.

    Examples
    --------
    >>> from jotlight.sensing.bits import Bits
    >>> from jotlight.view.viewed import Viewed
    >>> viewed = Viewed("../night sky.npy", Bits.from_array(np.ones((4, 2, 2), bool)), None)
    >>> file_name(viewed, ViewState(1, 2, "mle"), "tif")
    'night-sky-1-3-mle.tif'
    """
    stem = Path(viewed.title.replace("\\", "/")).stem
    letters = "".join(each if each.isascii() and each.isalnum() else "-" for each in stem)
    name = "-".join(filter(None, letters.split("-")))[:60] or "capture"
    return f"{name}-{state.start}-{state.start + state.window}-{state.method}.{ending}"
