"""How a capture is read: the parameters of `jotlight.open`, as one object."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from jotlight.checks import positive_number, shown, whole_number, whole_number_in_range
from jotlight.formats.frames.orientation import parse_orientation
from jotlight.formats.frames.raw_layout import RawLayout
from jotlight.sensing.parameters.reading_checks import MAX_BIT_DEPTH
from jotlight.sensing.parameters.slices import require_slice


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReadingOptions:
    """How a capture is read: the parameters of :func:`jotlight.open`, and a region.

    Raises
    ------
    TypeError, ValueError
        When a parameter has a wrong type, is out of range, or contradicts another one. The format
        and the key are compared with the known ones when a capture is read.

    Examples
    --------
    >>> ReadingOptions(counts_scale=255, trials=8).takes_counts
    True
    """

    format: str | None = None
    layout: str | None = None
    """The text of a :class:`RawLayout`, for raw frames."""
    width: int | None = None
    frames: slice | None = None
    rotate: int = 0
    flip: str | None = None
    region: tuple[slice, slice] | None = None
    """Some of the rows and columns, in jots after the rotation. Default: all."""
    key: str | None = None
    counts: bool | None = None
    unpacked: bool | None = None
    isolate: bool = False
    counts_scale: float | None = None
    trials: int | None = None
    bit_depth: int | None = None
    storage_options: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.width is not None:
            whole_number("width", self.width, 1)
        if self.layout is not None:
            self._check_layout(RawLayout.parse(self.layout))
        if self.frames is not None:
            require_slice("frames", self.frames)
        parse_orientation(self.rotate, self.flip)
        if not isinstance(self.key, str | None):
            raise TypeError(f"key: expected the name of an array, got {shown(self.key)}")
        for name in ("counts", "unpacked", "isolate"):
            value = getattr(self, name)
            if not (isinstance(value, bool) or (value is None and name != "isolate")):
                raise TypeError(f"{name}: expected True or False, got {shown(value)}")
        if not isinstance(self.storage_options, Mapping | None):
            raise TypeError(
                "storage_options: expected a dict of options by name, such as {'anon': True}, got "
                f"{shown(self.storage_options)}"
            )
        self._check_numbers()
        self._check_contradictions()

    def _check_layout(self, layout: RawLayout) -> None:
        """Raise ValueError for parameters that contradict the layout of raw frames."""
        if self.format not in (None, "raw"):
            raise ValueError(
                f"layout: is for raw frames without a format, not for {self.format!r}; leave out "
                "one of layout and format"
            )
        of_numbers = "unpacked", "counts", "counts_scale", "bit_depth"
        stated = next((name for name in of_numbers if getattr(self, name)), None)
        if stated is not None and layout.number_type is None:
            raise ValueError(
                f"{stated}: expected a layout of numbers, got one of eight bits to a byte; add a "
                f"type of numbers, such as {self.layout},dtype=uint8"
            )
        if self.unpacked is False and layout.number_type is not None:
            raise ValueError(
                "unpacked: False (--packed) is for eight bits to a byte, but the layout states "
                f"numbers of {layout.dtype}; leave out one of them"
            )

    def _check_numbers(self) -> None:
        """Raise TypeError or ValueError for a wrong statement of what the numbers are."""
        if self.counts_scale is not None:
            positive_number("counts_scale", self.counts_scale)
        if self.trials is not None:
            whole_number("trials", self.trials, 1)
        if self.bit_depth is not None:
            whole_number_in_range("bit_depth", self.bit_depth, 2, MAX_BIT_DEPTH)

    def _check_contradictions(self) -> None:
        """Raise ValueError for parameters that exclude each other."""
        if self.trials is not None and self.counts_scale is None:
            raise ValueError(
                "trials: states the frames of each mean, together with counts_scale= "
                "(--counts-scale); counts themselves need Sensor(frames=...) (--frames)"
            )
        if self.holds_readings and (self.unpacked or self.counts is False):
            raise ValueError(
                "bit_depth: is for images of readings, but bits are requested; leave out "
                "unpacked=True (--unpacked) and counts=False (--bits)"
            )
        if self.holds_means and self.holds_readings:
            raise ValueError(
                "counts_scale: is for images of means of frames, and bit_depth= (--bit-depth) for "
                "images of readings; leave out one of the two (--counts-scale)"
            )
        if self.unpacked and (self.counts or self.holds_means):
            name, option = "counts", "--counts"
            if self.holds_means:
                name, option = "counts_scale", "--counts-scale"
            raise ValueError(
                f"{name}: expected at most one of {name} and unpacked, got both ({option}, "
                "--unpacked)"
            )

    @property
    def holds_means(self) -> bool:
        """Whether the numbers are means of frames, times a scale."""
        return self.counts_scale is not None

    @property
    def holds_readings(self) -> bool:
        """Whether the numbers are readings of several bits."""
        return self.bit_depth is not None

    @property
    def takes_counts(self) -> bool | None:
        """Whether numbers are taken for counts, or for packed bits. None: their type decides.

        Means, readings, and unpacked bits are numbers like counts.
        """
        if self.counts is None and (self.holds_means or self.holds_readings):
            return True
        return True if self.unpacked else self.counts

    @property
    def path_key(self) -> str | None:
        """The key in a file of groups, without the slash of the root before it."""
        return None if self.key is None else self.key.lstrip("/")

    @property
    def takes_floats(self) -> bool:
        """Whether the numbers may be floats: means of frames, or unpacked bits."""
        return self.unpacked is True or self.holds_means

    @property
    def is_packed(self) -> bool:
        """Whether the caller states that bytes hold eight bits, so that this needs no check."""
        return self.unpacked is False

    @property
    def packed_width(self) -> int | None:
        """True width in jots of frames of packed bits, if it is stated."""
        return None if self.unpacked else self.width

    def stated(self) -> dict[str, Any]:
        """Return the options that differ from the defaults.

        Examples
        --------
        >>> ReadingOptions(rotate=90, key="a").stated()
        {'rotate': 90, 'key': 'a'}
        """
        fields = dataclasses.fields(self)
        values = {field.name: (getattr(self, field.name), field.default) for field in fields}
        return {name: value for name, (value, default) in values.items() if value != default}
