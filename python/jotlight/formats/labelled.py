"""Arrays by name in one file, HDF5 or zarr: which is meant, and whether it is bits or counts."""

import dataclasses
import json
from typing import Any

from jotlight.bits import Bits
from jotlight.errors import warn
from jotlight.formats.capture import Capture, as_stack, packed_on_reading
from jotlight.formats.description import describe
from jotlight.frames import Frames
from jotlight.sensor import Sensor
from jotlight.source import Source


@dataclasses.dataclass(frozen=True)
class Item:
    """An array in a file, and the label that we gave it, if we did."""

    frames: Frames
    label: str | None


def label(bits: Bits) -> dict[str, Any]:
    """What is written beside packed bits, as one attribute of JSON."""
    sensor = bits.sensor
    if sensor is not None and sensor.maps():
        warn(f"the format has no place for the sensor's {' and '.join(sensor.maps())}; left out")
        sensor = None
    told = describe(bits.width, sensor, bits.source)
    told.pop("maps", None)
    return told


def capture_of(
    found: dict[str, Item],
    source: Source,
    *,
    key: str | None,
    counts: bool | None,
    width: int | None,
) -> Capture:
    """The capture in one of the arrays."""
    if key is None and len(found) == 1:
        key = next(iter(found))
    if key not in found:
        told = "" if key is None else f", got {key!r}"
        names = ", ".join(found) or "it has none of numbers"
        raise ValueError(f"{source.name}: expected the name of an array (--key): {names}{told}")
    frames, text = found[key].frames, found[key].label
    try:
        if text is not None and not counts:
            return _labelled(frames, text, source, width)
        if counts is None and frames.dtype.kind == "b":
            counts = len(frames.shape) == 2
        if counts or (counts is None and frames.dtype.kind != "b"):
            return as_stack(frames, source)
        if len(frames.shape) not in (3, 4) or 0 in frames.shape:
            raise ValueError(f"expected frames (T, H, W) or (T, H, W, C), got {frames.shape}")
        if frames.dtype.kind == "b":
            return Bits(packed_on_reading(frames, source.name), frames.shape[2], source=source)
        source = source.with_note("packed bits, the most significant first, along the width")
        return Bits(frames, width, source=source)
    except (TypeError, ValueError) as error:
        if str(error).startswith(source.name):
            raise
        raise ValueError(f"{source.name}: {key}: {error}") from error


def _labelled(frames: Frames, text: str, source: Source, width: int | None) -> Bits:
    told = json.loads(text)
    if not isinstance(told, dict) or type(told.get("width")) is not int:
        raise ValueError("expected the label of packed bits to tell their width")
    if width not in (None, told["width"]):
        raise ValueError(f"its label says a width of {told['width']}, not {width}")
    sensor = Sensor.from_parts(told["sensor"]) if "sensor" in told else None
    if "source" in told:
        source = Source.from_json(told["source"])
    return Bits(frames, told["width"], sensor, source)
