"""Which captures the color network estimates, and how mosaics become colors."""

from typing import Any

from jotlight.cli.captured import Captured
from jotlight.estimators.demosaicing import COLORS, TITLES
from jotlight.evaluation.color_data import takes_mosaic
from jotlight.sensing.bits import Bits


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


def refuse_demosaicing(settings: dict[str, Any]) -> None:
    """Raise ValueError if the options of a method state how planes become colors.

    Merged counts have no planes.
    """
    demosaicing = settings.get("demosaicing")
    if demosaicing in TITLES:
        raise ValueError(
            f"demosaicing: {demosaicing} combines planes of pixels that see one color each, but "
            "along the motion each pixel is seen through all filters; leave it out"
        )


def without_demosaicing(settings: dict[str, Any]) -> dict[str, Any]:
    """Return the options of a method for merged counts, for which "network" is the default."""
    return {name: value for name, value in settings.items() if name != "demosaicing"}
