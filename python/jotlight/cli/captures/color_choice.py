"""Which captures the color network estimates, and how mosaics become colors."""

import dataclasses

from jotlight.cli.captures.captured import Captured
from jotlight.estimators.demosaicing import COLORS, TITLES
from jotlight.evaluation.color.color_data import takes_mosaic
from jotlight.evaluation.request import Request
from jotlight.sensing.bits.bits import Bits


def takes_capture(captured: Captured) -> bool:
    """Return whether a capture has the form that the color network takes."""
    if captured.sensor.mosaic is not None:
        return takes_mosaic(captured.data)
    frame = _frame_shape(captured)
    return len(frame) > 2 and frame[-1] == COLORS


def has_colors(captured: Captured) -> bool:
    """Return whether a capture has a mosaic or channels."""
    return captured.sensor.mosaic is not None or _frame_shape(captured)[2:] not in ((), (1,))


def _frame_shape(captured: Captured) -> tuple[int, ...]:
    """Return the shape of a frame, (H, W) or (H, W, C)."""
    data = captured.data
    return data.shape[1:] if isinstance(data, Bits) else data[0].shape


def refuse_demosaicing(request: Request) -> None:
    """Raise ValueError if a request states how planes become colors.

    Merged counts have no planes.
    """
    if request.demosaicing in TITLES:
        raise ValueError(
            f"demosaicing: {request.demosaicing} combines planes of pixels that see one color "
            "each, but along the motion each pixel is seen through all filters; leave it out"
        )


def without_demosaicing(request: Request) -> Request:
    """Return the request for merged counts, for which "network" is the default."""
    return dataclasses.replace(request, demosaicing=None)
