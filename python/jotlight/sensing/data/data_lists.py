"""Lists of bits, of readings, or of merged counts in place of the data of one image."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jotlight.checks import refuse_masked
from jotlight.paths import refuse_path
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor


def list_of_data(data: object) -> list[Bits | Readings | Merged]:
    """Return a list of bits, readings, or merged counts. Return an empty one for other data.

    Raises
    ------
    TypeError
        When only some of a list are bits, readings, or merged counts, or one is a path or a masked
        array. When data are an iterator, which can be read only once.
    ValueError
        When a list is empty, or its counts have different shapes.

    Examples
    --------
    >>> list_of_data([[3, 1], [0, 2]])
    []
    >>> list_of_data([])
    Traceback (most recent call last):
      ...
    ValueError: data: expected at least one image, got an empty list
    """
    if isinstance(data, Iterator):
        raise TypeError(
            f"data: expected bits, counts, or a list of them, got {type(data).__name__}; pass a "
            "list, such as list(bits.windows(16)), or one item at a time, which takes less memory"
        )
    if not isinstance(data, list | tuple):
        return []
    if not data:
        raise ValueError(f"data: expected at least one image, got an empty {type(data).__name__}")
    are_bits = [isinstance(one, Bits | Readings | Merged) for one in data]
    each: list[Any] = list(data) if all(are_bits) else []
    if any(are_bits) and not each:
        index = are_bits.index(False)
        raise TypeError(
            f"data: expected a list of only {type(data[are_bits.index(True)]).__name__}, got "
            f"{type(data[index]).__name__} at index {index}; leave it out, or pass it in another "
            "call"
        )
    if not each:
        _check_counts(data)
    return each


def _check_counts(data: Sequence[Any]) -> None:
    for one in data:
        refuse_path(one)
        refuse_masked("data", one)
    shapes = sorted({np.shape(one) for one in data})
    if len(shapes) > 1:
        raise ValueError(
            f"data: expected counts of the same shape in a list, got {shapes[0]} and {shapes[1]}; "
            "pass those of other shapes in another call"
        )


def carried_sensor(data: object) -> Sensor | None:
    """Return the sensor of bits or of merged counts. Return None for counts and bits without one.

    Raises
    ------
    TypeError, ValueError
        When the sensor of the bits is not a :class:`jotlight.Sensor`, or those of a list differ.
    """
    if sensors := [carried_sensor(each) for each in list_of_data(data)]:
        if any(each != sensors[0] for each in sensors):
            raise ValueError("data: expected bits of the same sensor, got different ones")
        return sensors[0]
    sensor = data.sensor if isinstance(data, Bits | Readings | Merged) else None
    if not isinstance(sensor, Sensor | None):
        raise TypeError(f"sensor: expected jotlight.Sensor, got {type(sensor).__name__}")
    return sensor
