"""What the page shows: the state of its controls, read from untrusted JSON."""

import dataclasses
from typing import Any, Self

from jotlight.evaluation.methods import COLOR_NETWORK, METHODS
from jotlight.images.tone import CURVES

MAX_STATE_BYTES = 1 << 14
"""Maximum size of a message from the page."""

OVERLAYS = "jots", "saturated", "uncertainty"
"""Overlays of an image: dead and hot jots, saturated pixels, and the standard error."""

COUNTS = "counts"
"""The name, beside those of methods, that shows the counts."""

MAX_WHITE = 1e30
"""White is below this intensity, and above its reciprocal."""

_MAX_FRAME = 1 << 53
"""Above this number, the page's numbers are not whole."""


@dataclasses.dataclass(frozen=True)
class ViewState:
    """The state of the page's controls.

    Parameters
    ----------
    start : int
        First frame of the window.
    window : int
        Number of frames.
    method : str
        A key of ``METHODS``, "network-color", or "counts".
    compare : str, optional
        Another method, of which the page shows the difference. Default: none.
    align : bool
        Whether the frames are aligned.
    curve : str
        Tone curve, a key of ``CURVES``.
    white : float, optional
        The intensity that is white. Default: the 99.5th percentile of the image.
    overlays : tuple of str
        Some of :data:`OVERLAYS`.
    follow : bool
        Whether the window ends at the newest frame of a live capture.

    Examples
    --------
    >>> ViewState.from_json({"start": 3, "window": 16, "method": "mle"}).window
    16
    >>> ViewState.from_json({"window": -1})
    Traceback (most recent call last):
      ...
    ValueError: window: expected a whole number from 1 to 9007199254740992, got -1
    """

    start: int = 0
    window: int = 1
    method: str = "mle"
    compare: str | None = None
    align: bool = False
    curve: str = "gamma"
    white: float | None = None
    overlays: tuple[str, ...] = ()
    follow: bool = False

    @classmethod
    def from_json(cls, value: Any) -> Self:
        """Return the state in an object of JSON.

        Raises
        ------
        ValueError
            When a name is unknown, or a value is not of its kind or out of its range.
        """
        if not isinstance(value, dict):
            raise ValueError(f"state: expected an object, got {type(value).__name__}")
        names = {field.name for field in dataclasses.fields(cls)}
        if unknown := value.keys() - names:
            raise ValueError(f"state: expected {', '.join(sorted(names))}, got {min(unknown)!r}")
        checked: dict[str, Any] = {name: _CHECKS[name](name, item) for name, item in value.items()}
        return cls(**checked)

    def to_json(self) -> dict[str, Any]:
        """Return the state as an object of JSON, without defaults."""
        values = dataclasses.asdict(self)
        return {name: item for name, item in values.items() if item != getattr(type(self), name)}

    def within(self, frames: range, cycle: int) -> Self:
        """Return the state with a window that lies in the available frames, in whole cycles.

        Examples
        --------
        >>> ViewState(start=90, window=20).within(range(100), 1).span
        range(80, 100)
        >>> ViewState(start=2, window=20).within(range(99), 3).span
        range(0, 18)
        """
        window = max(cycle, min(self.window, len(frames)) // cycle * cycle)
        last = frames.stop - window
        start = last if self.follow else max(frames.start, min(self.start, last))
        start -= (start - frames.start) % cycle
        return dataclasses.replace(self, start=start, window=window)

    @property
    def span(self) -> range:
        """The frames of the window."""
        return range(self.start, self.start + self.window)


def _whole(name: str, value: Any, minimum: int) -> int:
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if not is_whole or not minimum <= value < _MAX_FRAME:
        raise ValueError(
            f"{name}: expected a whole number from {minimum} to {_MAX_FRAME}, got {_short(value)}"
        )
    return int(value)


def _one_of(name: str, value: Any, choices: Any) -> str:
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name}: expected one of {', '.join(choices)}, got {_short(value)}")
    return value


def _flag(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{name}: expected true or false, got {_short(value)}")
    return value


def _white(name: str, value: Any) -> float | None:
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 1 / MAX_WHITE < value < MAX_WHITE:
        raise ValueError(
            f"{name}: expected an intensity from {1 / MAX_WHITE:g} to {MAX_WHITE:g}, got "
            f"{_short(value)}"
        )
    return float(value)


def _overlays(name: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or len(value) > len(OVERLAYS):
        raise ValueError(f"{name}: expected a list of overlays, got {_short(value)}")
    return tuple(dict.fromkeys(_one_of(name, item, OVERLAYS) for item in value))


def parse_probe(message: dict[str, Any]) -> tuple[int, int] | None:
    """Return the row and the column of the pointer, or None if it is outside of the image."""
    if message.get("row") is None:
        return None
    return _whole("row", message["row"], 0), _whole("column", message.get("column"), 0)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


_CHECKS = {
    "start": lambda name, value: _whole(name, value, 0),
    "window": lambda name, value: _whole(name, value, 1),
    "method": lambda name, value: _one_of(name, value, (COUNTS, COLOR_NETWORK, *METHODS)),
    "compare": lambda name, value: (
        None if value is None else _one_of(name, value, (COLOR_NETWORK, *METHODS))
    ),
    "align": _flag,
    "curve": lambda name, value: _one_of(name, value, CURVES),
    "white": _white,
    "overlays": _overlays,
    "follow": _flag,
}
"""Functions that check the values of a state, by name."""
