"""8-bit levels for display: estimates through a tone curve, and differences in two colors."""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Levels
from jotlight.images.io import display_levels
from jotlight.images.tone import CURVES, PERCENTILE, Tone
from jotlight.view.estimate import Estimate, estimate, fraction_at
from jotlight.view.state import COUNTS, MAX_WHITE, ViewState
from jotlight.view.viewed import Viewable

_MARGIN = 1e4
"""Factor between white and its limits."""

_NEGATIVE, _ZERO, _POSITIVE = (43, 131, 203), (128, 128, 128), (222, 107, 32)
"""Colors of the differences: blue for darker, gray for equal, orange for brighter."""


@dataclasses.dataclass(frozen=True)
class Displayed:
    """An image in 8-bit levels, (H, W) or (H, W, 3), and how its values became levels."""

    levels: Levels
    tone: dict[str, Any]
    """Curve, white, and the values at five levels from black to white, as values of JSON."""


def fit_white(viewed: Viewable, span: range, made: Estimate) -> float:
    """Return the intensity that becomes white if the user sets none: the 99.5th percentile.

    For counts, it is that of maximum likelihood, which is as bright.
    """
    if made.method == COUNTS:
        made = estimate(viewed, span, "mle", made.counts)
    white = Tone.fit(displayable(made.image), percentile=PERCENTILE).white
    # The page may change the exposure by several stops.
    return min(max(white, _MARGIN / MAX_WHITE), MAX_WHITE / _MARGIN)


def tone_of(made: Estimate, state: ViewState, white: float) -> Tone:
    """Return the tone curve of an estimate.

    A fraction of ones is as bright as the intensity from which it is expected, so that the image
    does not flash when the estimate replaces the counts.
    """
    if made.method == COUNTS:
        white = fraction_at(white, made.sensor)
    if state.curve == "reinhard":  # the only curve that depends on the image
        return Tone.fit(displayable(made.image), state.curve, white=white)
    return Tone(state.curve, white)


def display(made: Estimate, state: ViewState, white: float) -> Displayed:
    """Return an estimate in the levels that :func:`jotlight.save_image` writes for it.

    Examples
    --------
    >>> counts = np.array([[0, 1, 2, 4]], np.int32)
    >>> image = (counts / 4).astype(np.float32)
    >>> made = Estimate(
    ...     image=image, counts=counts, trials=4, sensor=jl.Sensor(frames=4),
    ...     method="mle", title="", seconds=0.0, data=counts,
    ... )
    >>> display(made, ViewState(curve="linear"), 1.0).levels.tolist()
    [[0, 64, 128, 255]]
    """
    tone = tone_of(made, state, white)
    if made.is_function_of_counts:
        # The curve is computed once for each number of ones, rather than for each pixel.
        table = np.zeros(int(made.counts.max()) + 1, np.float32)
        table[made.counts] = made.image
        levels = _levels(table, tone)[made.counts]
    else:
        levels = _levels(displayable(made.image), tone)
    facts = {"curve": tone.curve, "white": white, "axis": _axis(tone)}
    return Displayed(levels, facts)


def _levels(image: npt.NDArray[np.float32], tone: Tone) -> Levels:
    return display_levels(tone(image), 1.0, 255).astype(np.uint8)


def displayable(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return an image (H, W) or (H, W, 3). Two or four channels become their mean."""
    if image.ndim == 3 and image.shape[2] != 3:
        return np.asarray(image.mean(axis=2, dtype=np.float32))
    return image


def _axis(tone: Tone) -> list[float]:
    """Return the values that appear as 0, 1/4, 1/2, 3/4, and 1 of the display."""
    x = np.linspace(0, 1, 1025)
    shown = CURVES[tone.curve](x, tone.middle)
    return [float(tone.white * np.interp(level / 4, shown, x)) for level in range(5)]


def display_difference(one: Estimate, other: Estimate, white: float) -> Displayed:
    """Return the difference of two estimates in colors: blue is darker, and orange brighter.

    The strongest colors stand for a quarter of white. Differences of color images are those of
    the mean of their channels.
    """
    difference = one.image - other.image
    if difference.ndim == 3:
        difference = difference.mean(axis=2)
    limit = white / 4
    position = np.clip(difference / np.float32(limit), -1, 1)
    negative, zero, positive = (
        np.array(color, np.float32) for color in (_NEGATIVE, _ZERO, _POSITIVE)
    )
    weight = np.abs(position)[..., None]
    ends = np.where(position[..., None] < 0, negative, positive)
    levels = np.rint(zero + weight * (ends - zero)).astype(np.uint8)
    axis = [limit * step / 2 for step in range(-2, 3)]
    rms = float(np.sqrt(np.mean(np.square(difference, dtype=np.float64))))
    facts = {"curve": "difference", "white": white, "axis": axis, "rms": rms, "other": other.title}
    return Displayed(levels, facts)
