"""How a capture is read: the parameters of `jotlight.open`, as one object."""

import dataclasses
from typing import Any


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReadingOptions:
    """How a capture is read: the parameters of :func:`jotlight.open`, and a region.

    Raises
    ------
    ValueError
        When `trials` is stated without `counts_scale`.

    Examples
    --------
    >>> ReadingOptions(counts_scale=255, trials=8).takes_counts
    True
    """

    format: str | None = None
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
        if self.trials is not None and self.counts_scale is None:
            raise ValueError(
                "trials: states the frames of each mean, together with counts_scale= "
                "(--counts-scale); counts themselves need Sensor(frames=...) (--frames)"
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
        """Whether numbers are taken for counts, or for bits. None: their type decides.

        Means and readings are numbers like counts.
        """
        if self.counts is None and (self.holds_means or self.holds_readings):
            return True
        return self.counts

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
