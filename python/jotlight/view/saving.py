"""Files of the image that the page shows: PNG of 16 bits, TIFF, and EXR."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from jotlight.estimators.brightness import UNITS
from jotlight.evaluation.methods import COLOR_NETWORK
from jotlight.evaluation.records.records import image_facts, maps_sha256, tone_facts
from jotlight.evaluation.records.weights import weight_files, weights_sha256
from jotlight.formats.capture import CountStack
from jotlight.formats.frames.checked_reading import with_checksum
from jotlight.formats.opening.locations import file_state, is_url
from jotlight.images.exr import check_exr
from jotlight.images.io import image_writer
from jotlight.motion.motion import Motion
from jotlight.parameter_names import check_choice
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.view.alignment import merge_window
from jotlight.view.display import display_difference, displayable, fit_white, tone_of
from jotlight.view.estimate import DEMOSAICING, Estimate, choose, estimate
from jotlight.view.running_counts import RunningCounts
from jotlight.view.state import COUNTS, ViewState
from jotlight.view.viewed import Frames, Viewable

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
    >>> from jotlight.view.viewed import Viewed
    >>> viewed = Viewed.from_data(jl.Bits.from_array(np.ones((4, 2, 2), bool)))
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
    merged, motion = None, None
    if state.align and state.method != COUNTS:
        merged, motion = merge_window(viewed, state.span, state.method)
    made = estimate(viewed, state.span, state.method, counts, merged)
    other = None
    if state.compare is not None and state.method != COUNTS:
        other = estimate(viewed, state.span, state.compare, counts, merged)
    values, shown = _values(viewed, made, other, state, ending)
    note = _note(viewed, state, made, other, motion) | shown
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"view.{ending}")
        write = image_writer(file, depth=16 if ending == "png" else 8, note=note)
        write(file, values)
        return file.read_bytes()


def _values(
    viewed: Viewable, made: Estimate, other: Estimate | None, state: ViewState, ending: str
) -> tuple[Any, dict[str, Any]]:
    """Return the values to write: intensities, or for PNG values from 0 to 1.

    Also return the curve and the white of a PNG.
    """
    if ending != "png":
        return displayable(made.image if other is None else made.image - other.image), {}
    white = fit_white(viewed, state.span, made) if state.white is None else state.white
    if other is not None:
        difference = display_difference(made, other, white)
        shown = {"curve": difference.tone["curve"], "white": white}
        return difference.levels / np.float32(255), shown
    tone = tone_of(made, state, white)
    return tone(displayable(made.image)), tone_facts(tone)


def _note(
    viewed: Viewable,
    state: ViewState,
    made: Estimate,
    other: Estimate | None,
    motion: Motion | None,
) -> dict[str, Any]:
    """Return what a file states about its image, as files of `jotlight reconstruct` do."""
    sensor, units, weights = viewed.sensor(state.window), made.counted.units, None
    if state.method != COUNTS:
        choice = choose(viewed, state.window, made.method)
        sensor = sensor.replace(max_intensity=choice.max_intensity)
        units = UNITS["intensity"]
        facts = choice.method, choice.quality
        weights = weights_sha256(weight_files([made.sensor], *facts, is_color=choice.is_color))
    largest = 1.0 if state.method == COUNTS else sensor.max_intensity
    part = viewed.part(state.span)
    provenance = part.provenance or viewed.provenance
    has_planes = sensor.mosaic is not None and made.method not in (COUNTS, COLOR_NETWORK)
    return {
        **image_facts(sensor, made.method, provenance, units=units, largest_value=largest),
        **_capture_facts(viewed, part),
        "frames": f"{state.start}:{state.span.stop}",
        "difference_to": None if other is None else other.method,
        "weights_sha256": weights,
        "maps_sha256": maps_sha256(sensor),
        "options": (
            {"demosaicing": DEMOSAICING} if has_planes and not isinstance(made.data, Merged) else {}
        ),
        "motion": None if motion is None else _motion_facts(motion),
        **viewed.opening.facts,
    }


def _motion_facts(motion: Motion) -> dict[str, Any]:
    """Return how the frames were aligned."""
    return {"model": "auto", "upsample": 1, "found": motion.model, "at": motion.reference}


def _capture_facts(viewed: Viewable, part: Frames) -> dict[str, Any]:
    """Return the name of a capture, and the size and the CRC-32 of the frames of a window."""
    if isinstance(part, Readings):
        part = CountStack(part.frames, Provenance("", ""))  # of which only the frames matter
    size, checksum = with_checksum(part)[1]()
    content = "packed" if isinstance(part, Bits) else "counts"
    return {
        "capture": viewed.title,
        "bytes": _file_size(viewed.opening.path),
        f"{content}_bytes": size,
        f"{content}_crc32": f"{checksum:08x}",
    }


def _file_size(path: str | None) -> int | None:
    """Return the size of the files of a capture, or None for URLs and files that have vanished."""
    if path is None or is_url(path):
        return None
    try:
        return file_state(path)[0]
    except OSError:  # frames in memory can still be saved
        return None


def file_name(viewed: Viewable, state: ViewState, ending: str) -> str:
    """Return a name for a file, of letters and digits that every system accepts.

    Examples
    --------
    >>> from jotlight.view.viewed import Viewed
    >>> viewed = Viewed("../night sky.npy", jl.Bits.from_array(np.ones((4, 2, 2), bool)), None)
    >>> file_name(viewed, ViewState(1, 2, "mle"), "tif")
    'night-sky-1-3-mle.tif'
    """
    stem = Path(viewed.title.replace("\\", "/")).stem
    letters = "".join(each if each.isascii() and each.isalnum() else "-" for each in stem)
    name = "-".join(filter(None, letters.split("-")))[:60] or "capture"
    return f"{name}-{state.start}-{state.start + state.window}-{state.method}.{ending}"
