"""Facts about captures, as rows of a table."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Mask
from jotlight.calibration.hot_jots import hot_jots_unknown_reason
from jotlight.cli.captures.jot_checks import jot_remarks
from jotlight.cli.terminal.console import progress
from jotlight.formats.capture import Capture, CountStack
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor

_MAX_BYTES = 1 << 30
"""Number of bytes of frames that are read for the fraction of ones. A disk takes seconds."""


def notes(capture: Capture) -> list[tuple[str, str]]:
    """Return the assumptions about a file, and its origin: a simulation, or earlier conversions.

    Of a stack of images of counts, the sum is shown.
    """
    is_summed = isinstance(capture, CountStack) and capture.sensor is None
    provenance = capture.sum_provenance if is_summed else capture.provenance
    return [] if provenance is None else provenance_rows(provenance)


def provenance_rows(provenance: Provenance) -> list[tuple[str, str]]:
    """Return the rows about how a file was read, and about its origin."""
    lines = provenance.describe(checksums=True)
    return [("" if index else "provenance", line) for index, line in enumerate(lines)]


def bits_facts(bits: Bits) -> list[tuple[str, str]]:
    """Return the facts about bits. The ones of a large capture are those of its first frames."""
    frames, height, width, *channels = bits.shape
    part = bits[: _number_of_counted(frames, bits.packed.nbytes)]
    with progress(1) as begin:
        counts = part.counts(1, progress=begin("counting"))
    sensor = carried_sensor(bits)
    mask = None if sensor is None else sensor.mask
    live = _live_jots(counts, mask)
    ones = live.sum(dtype=np.int64) / max(live.size * len(part), 1)
    facts = [
        ("kind", "bits" if not channels else f"bits of {channels[0]} channels"),
        *([("format", bits.provenance.format)] if bits.provenance is not None else []),
        ("frames", str(frames)),
        ("jots", f"{height} x {width}"),
        ("size", f"{bits.packed.nbytes / 1e6:.3g} MB packed"),
        ("ones", f"{ones:.3%}{_of_live(mask)}{_of_first(len(part), frames)}"),
    ]
    assumed = carried_sensor(part) or Sensor(frames=len(part))
    is_unknown = hot_jots_unknown_reason(part, assumed) is not None
    jots = [] if is_unknown else jot_remarks(counts, len(part), assumed)
    if sensor is None:
        return [*facts, ("sensor", "not stated"), *jots]
    pixels = f"{height // sensor.oversampling} x {width // sensor.oversampling}"
    return [
        *facts,
        ("sensor", repr(sensor)),
        ("pixels", f"{pixels}, {_bits_of_pixels(sensor)} each"),
        *jots,
    ]


def _live_jots(values: npt.NDArray[np.integer], mask: Mask | None) -> npt.NDArray[np.integer]:
    """Return the values of the jots that are not dead, of values (H, W) or (H, W, C)."""
    return values if mask is None else values[~mask]


def _of_live(mask: Mask | None) -> str:
    """Return that a fraction is one of live jots, if others are dead."""
    return "" if mask is None else " (live jots)"


def _number_of_counted(frames: int, nbytes: int) -> int:
    """Return the number of frames whose ones are counted, of frames of a number of bytes."""
    return frames if nbytes <= _MAX_BYTES else max(1, _MAX_BYTES * frames // nbytes)


def _of_first(number: int, frames: int) -> str:
    """Return that a fraction is one of the first frames, if there are more."""
    return "" if number == frames else f" (the first {number:,} frames)"


def _bits_of_pixels(sensor: Sensor) -> str:
    """Return how many bits a pixel has, without those of dead jots."""
    if sensor.mask is None:
        return f"{sensor.trials} bits"
    trials = sensor.frames * Bits.from_array(~sensor.mask).counts(sensor.oversampling)
    low, high = trials.min(), trials.max()
    return f"{low if low == high else f'{low} to {high}'} valid bits"


def readings_facts(readings: Readings) -> list[tuple[str, str]]:
    """Return the facts about readings of several bits, of a large capture of its first frames."""
    sensor, highest = readings.sensor, 2**readings.sensor.bit_depth - 1
    total, largest, mask = 0, 0, sensor.maps().get("mask")
    counted = _number_of_counted(len(readings), readings.frames.nbytes)
    for start in range(counted):
        frame = _live_jots(readings[start], mask)
        total += int(frame.sum(dtype=np.int64))
        largest += int((frame == highest).sum())
    frames, height, width, *_ = readings.shape
    number, first = max(frame.size * counted, 1), _of_first(counted, frames)
    return [
        ("kind", f"readings of {sensor.bit_depth} bits"),
        *([] if readings.provenance is None else [("format", readings.provenance.format)]),
        ("frames", str(frames)),
        ("jots", f"{height} x {width}"),
        ("mean", f"{total / number:.4g} of {highest}{_of_live(mask)}{first}"),
        ("largest", f"{largest / number:.3%} of the readings are {highest}{first}"),
        ("sensor", repr(sensor)),
    ]
