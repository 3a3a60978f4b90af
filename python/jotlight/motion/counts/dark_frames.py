"""Dark frames: those that a shutter, a strobe light, or a lost transfer left without light.

They say nothing about the scene or its motion. So they are not counted, neither their ones nor
their trials.
"""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Mask
from jotlight.errors import warn

_DARK = 1 / 8
"""A frame is dark if it has less than this fraction of the mean light of all frames."""

_CLEAR = 12.0
"""Number of standard deviations by which the mean light must exceed the limit.

Of frames with less light, several successive ones are tested together. By a lower number, dim
frames of a flicker would be dark by chance.
"""

_LISTED = 3
"""Maximum number of spans of dark frames that a warning lists."""


def find_dark(ones: npt.NDArray[np.integer], dark_ones: float) -> Mask:
    """Return the frames without light, (T,). If all are without light, none is returned.

    Parameters
    ----------
    ones : ndarray of int, shape (T,)
        Number of ones of each frame.
    dark_ones : float
        How many of them dark counts explain.

    Examples
    --------
    >>> find_dark(np.array([900, 950, 0, 3, 910]), 0.0).tolist()
    [False, False, True, True, False]
    >>> find_dark(np.array([2, 0, 1, 0, 0, 1]), 0.0).any()  # too little light for a decision
    np.False_
    """
    number, light = len(ones), float(ones.mean()) - dark_ones
    if light <= 0:
        return np.zeros(number, bool)
    # By chance, the ones of a lit group would hardly ever be as few.
    length = max(1, int(np.ceil((light + dark_ones) * (_CLEAR / ((1 - _DARK) * light)) ** 2)))
    starts = np.arange(0, max(1, number - length + 1), length)
    lengths = np.diff(np.append(starts, number))
    groups = np.add.reduceat(ones, starts) - lengths * dark_ones
    return np.repeat(groups < _DARK * light * lengths, lengths)


def as_spans(frames: Mask) -> list[range]:
    """Return the spans of successive frames that are True.

    Examples
    --------
    >>> as_spans(np.array([True, True, False, True]))
    [range(0, 2), range(3, 4)]
    """
    ends = np.flatnonzero(np.diff(frames, prepend=False, append=False))
    return [range(int(start), int(stop)) for start, stop in ends.reshape(-1, 2)]


def report_dark(spans: list[range], time: float | None = None, end: int | None = None) -> None:
    """Warn that spans of dark frames are not used.

    The image shows a `time`, if there is only one. At the `end`, if there is one, dark frames may
    continue.
    """
    if not spans:
        return
    listed = [_as_text(span, end) for span in spans[:_LISTED]]
    rest = ", and others" if len(spans) > _LISTED else ""
    text = f"dark frames are not used: {', '.join(listed)}{rest}"
    if time is not None and any(span.start <= time < span.stop for span in spans):
        text += f"; the image shows time {time:g}, which is dark, so its motion is a guess"
    warn(text)


def _as_text(span: range, end: int | None) -> str:
    """Return the numbers of the frames of a span as a text.

    Examples
    --------
    >>> _as_text(range(8, 9), None), _as_text(range(8, 12), 20), _as_text(range(8, 20), 20)
    ('8', '8 to 11', '8 and dark ones that follow it')
    """
    if span.stop == end:
        return f"{span.start} and dark ones that follow it"
    return f"{span.start}" if len(span) == 1 else f"{span.start} to {span.stop - 1}"
