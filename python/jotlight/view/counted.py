"""What the counts of pixels are, in the words of the page."""

import dataclasses

from jotlight.sensing.sensor import Sensor


@dataclasses.dataclass(frozen=True)
class Counted:
    """What is counted."""

    name: str
    """Name of the counts of a pixel."""
    title: str
    """Name of their image, beside those of methods."""
    units: str
    """Units of the values of that image."""
    mean: str
    """Name of the mean of a reading."""
    largest: int = 1
    """The largest reading."""


ONES = Counted("ones", "fraction of ones", "fraction of ones", "firing rate")
"""Single bits."""

EQUIVALENT = dataclasses.replace(ONES, name="equivalent ones", mean="equivalent firing rate")
"""Equivalent counts, which aligned readings become that are not plain bits."""


def counted_by(sensor: Sensor) -> Counted:
    """Return what is counted in the readings of a sensor: ones of bits, or sums of readings.

    Examples
    --------
    >>> counted_by(jl.Sensor(frames=4)).name, counted_by(jl.Sensor(frames=4, bit_depth=2)).name
    ('ones', 'sum of readings')
    """
    if sensor.bit_depth == 1:
        return ONES
    name = "sum of readings"
    units = "fraction of the largest possible sum of readings"
    return Counted(name, name, units, "mean reading", sensor.max_reading)
