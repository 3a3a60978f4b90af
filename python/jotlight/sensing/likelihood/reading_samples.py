"""The readings of each pixel in the form in which their likelihood is computed."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.memory import check_memory
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.bits.frames import read_in_chunks
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.parameters.reading_groups import ReadingGroup
from jotlight.sensing.sensor import Sensor


@dataclasses.dataclass(frozen=True)
class Sample:
    """The readings of all cells of a group. A cell is a square of jots."""

    values: npt.NDArray[np.int32]
    """How often each reading occurs, or the readings themselves, (H, W, number); -1 is none."""
    is_histogram: bool


def require_readings(data: object, sensor: Sensor) -> Readings:
    """Return data as readings of several bits. An image of one frame is one.

    Raises
    ------
    ValueError
        When the data are bits or sums of readings.
    """
    if isinstance(data, Readings):
        check_fits(data.shape, sensor, bit_depth=data.bit_depth)
        return data
    if isinstance(data, np.ndarray) and sensor.trials == 1:
        return Readings(data, sensor)
    kind = "an image of sums" if isinstance(data, np.ndarray) else type(data).__name__
    raise ValueError(
        f"data: expected jotlight.Readings, because the sensor has {sensor.bit_depth} bits per "
        f"reading, got {kind}; a sum does not say which readings were the largest, so pass all "
        "frames: jotlight.Readings(frames, sensor)"
    )


def sample_readings(
    readings: Readings, groups: Sequence[ReadingGroup[Sensor]], oversampling: int
) -> list[Sample]:
    """Return the readings of each group in squares of jots. The frames are read once.

    They are histograms, unless each cell has fewer readings than these have values.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=2, bit_depth=2, oversampling=1)
    >>> readings = jl.Readings([[[0, 1]], [[3, 1]]], sensor)
    >>> sample_readings(readings, readings.sensor.groups(), 1)[0].values.tolist()
    [[[0, 3], [1, 1]]]
    """
    height, width = (size // oversampling for size in readings.shape[1:3])
    numbers = [len(group.frames) * oversampling**2 for group in groups]
    levels = 2 ** groups[0].sensor.bit_depth
    # Readings in a row need no memory for values that never occur.
    rows = [number < levels for number in numbers]
    entries = [number if row else levels for number, row in zip(numbers, rows, strict=True)]
    check_memory(
        "readings", 4 * height * width * sum(entries), "take parts of the frames: readings[a:b]"
    )
    values = [
        np.full((height * width, number), -1 if row else 0, np.int32)
        for number, row in zip(entries, rows, strict=True)
    ]
    filled = [0] * len(groups)
    for place, _ in read_in_chunks(readings.frames):
        part = readings.read(place.start, place.stop)
        for index, group in enumerate(groups):
            inside = group.frames[(group.frames >= place.start) & (group.frames < place.stop)]
            live = None if group.sensor.mask is None else ~group.sensor.mask
            for frame in part[inside - place.start]:
                _add_frame(values[index], frame, live, oversampling, filled[index], rows[index])
                filled[index] += oversampling**2
    return [
        Sample(each.reshape(height, width, -1), not row)
        for each, row in zip(values, rows, strict=True)
    ]


def _add_frame(
    values: npt.NDArray[np.int32],
    frame: npt.NDArray[np.uint16],
    live: npt.NDArray[np.bool_] | None,
    oversampling: int,
    filled: int,
    are_rows: bool,
) -> None:
    """Add the readings of a frame to the rows or the histograms of the cells."""
    cells = np.arange(len(values))
    for number, (row, column) in enumerate(np.ndindex(oversampling, oversampling)):
        jots = slice(row, None, oversampling), slice(column, None, oversampling)
        own, places = frame[jots].reshape(-1), cells
        if live is not None:
            alive = live[jots].reshape(-1)
            own, places = own[alive], places[alive]
        if are_rows:
            values[places, filled + number] = own
        else:
            # Each place occurs once, so that the addition is complete.
            values[places, own] += 1
