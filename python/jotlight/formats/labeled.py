"""Arrays by name in one file, HDF5 or zarr: which is meant, and whether it is bits or counts."""

import dataclasses
import json
from typing import Any

import numpy as np

from jotlight.formats.capture import Capture, as_count_stack, check_packed, pack_lazily
from jotlight.formats.description import BITS, describe, parse_label
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames
from jotlight.sensing.maps import MAPS
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor


@dataclasses.dataclass(frozen=True)
class StoredArray:
    """An array in a file, and the label that we gave it, if we did."""

    frames: Frames
    label: str | None


def label(bits: Bits) -> str:
    """What is written beside packed bits, as one attribute; maps are arrays under their names."""
    told = describe(bits.width, bits.sensor, bits.provenance)
    if bits.sensor is not None:
        told["maps"] = {name: name for name in bits.sensor.maps()}
    return json.dumps(told)


def open_stored_array(
    found: dict[str, StoredArray],
    provenance: Provenance,
    *,
    key: str | None,
    counts: bool | None,
    width: int | None,
    sure: bool = False,
) -> Capture:
    """The capture in one of the arrays; packed bits are to look so, unless the user is `sure`."""
    labelled = [name for name, item in found.items() if item.label is not None]
    if key is None and (len(found) == 1 or len(labelled) == 1):
        key = next(iter(labelled or found))
    if key not in found:
        told = "" if key is None else f", got {key!r}"
        names = ", ".join(found) or "it has none of numbers"
        raise ValueError(f"{provenance.name}: expected the name of an array (--key): {names}{told}")
    frames, text = found[key].frames, found[key].label
    try:
        ours = None if text is None or counts else parse_label(text, BITS)
        if ours is not None:
            return _labelled(found, frames, ours, provenance, width)
        if counts is None and frames.dtype.kind == "b":
            counts = len(frames.shape) == 2
        if counts or (counts is None and frames.dtype.kind != "b"):
            return as_count_stack(frames, provenance, text)
        if len(frames.shape) not in (3, 4) or 0 in frames.shape:
            raise ValueError(f"expected frames (T, H, W) or (T, H, W, C), got {frames.shape}")
        if frames.dtype.kind == "b":
            return Bits(
                pack_lazily(frames, provenance.name), frames.shape[2], provenance=provenance
            )
        if not sure:
            check_packed(frames, provenance.name)
        provenance = provenance.with_notes(
            "packed bits, the most significant first, along the width"
        )
        return Bits(frames, width, provenance=provenance)
    except (TypeError, ValueError) as error:
        if str(error).startswith(provenance.name):
            raise
        raise ValueError(f"{provenance.name}: {key}: {error}") from error


def _labelled(
    found: dict[str, StoredArray],
    frames: Frames,
    told: dict[str, Any],
    provenance: Provenance,
    width: int | None,
) -> Bits:
    if type(told.get("width")) is not int:
        raise ValueError("expected the label of packed bits to tell their width")
    if width not in (None, told["width"]):
        raise ValueError(f"its label says a width of {told['width']}, not {width}")
    bits = Bits(frames, told["width"])
    if told.get("provenance") is not None:
        provenance = provenance.converted_from(Provenance.from_json(told["provenance"]))
    if told.get("sensor") is None:
        return Bits(frames, bits.width, provenance=provenance)
    places = told.get("maps") or {}
    if not isinstance(places, dict) or not places.keys() <= set(MAPS):
        raise ValueError(f"maps: expected arrays for {' and '.join(MAPS)}, got {places!r}")
    maps = {}
    for name, place in places.items():
        if place not in found or found[place].frames.shape != bits.shape[1:3]:
            raise ValueError(f"{name}: expected an array of {bits.shape[1:3]} jots, {place!r}")
        maps[name] = np.asarray(found[place].frames)
    return Bits(frames, bits.width, Sensor.from_parts(told["sensor"], maps), provenance)
