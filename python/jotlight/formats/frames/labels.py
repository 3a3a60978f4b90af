"""JSON labels: the metadata of bits or counts, the same for all formats that store them."""

import json
from typing import Any

from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.sensor_like import SensorLike

BITS = "jotlight bits"
"""Value of "format" in a label of packed bits."""

COUNTS = "jotlight counts"
"""Value of "format" in a label of counts."""

READINGS = "jotlight readings"
"""Value of "format" in a label of readings of several bits."""

VERSION = 2
"""Value of "version" in a label."""

AS_STATED = (
    "leave out counts=True (--counts), unpacked=True (--unpacked), bit_depth= (--bit-depth), and "
    "counts_scale= (--counts-scale)"
)
"""Advice for a file whose label contradicts the arguments."""

MAX_LABEL_BYTES = 1 << 20
"""Maximum size in bytes of a label that is read."""


def parse_label(text: str, format_: str) -> dict[str, Any] | None:
    """Return the JSON object in a text, or None when it is not a label of this format.

    Examples
    --------
    >>> parse_label('{"format": "jotlight counts", "trials": 10}', COUNTS)
    {'format': 'jotlight counts', 'trials': 10}
    >>> parse_label("[1, 2]", COUNTS) is None
    True
    """
    try:
        label = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return label if isinstance(label, dict) and label.get("format") == format_ else None


def make_bits_label(
    width: int, sensor: SensorLike | None, provenance: Provenance | None
) -> dict[str, Any]:
    """Return the label of packed bits. The caller adds the locations of the sensor's maps.

    Raises
    ------
    ValueError
        When the label would be too long, because the sensor has values for very many frames.
    """
    label: dict[str, Any] = {"format": BITS, "version": VERSION, "width": width}
    if sensor is not None:
        label["sensor"] = sensor.scalars()
        label["maps"] = {}
    if provenance is not None:
        label["provenance"] = provenance.to_json()
    # The checksums and locations that are added take much less than half of the limit.
    if (size := len(json.dumps(label))) > MAX_LABEL_BYTES // 2:
        raise ValueError(
            f"bits: expected a description of at most {MAX_LABEL_BYTES // 2} bytes, got {size}, "
            "because the gain or the threshold differs in very many frames; save parts of the "
            "frames: bits[a:b]"
        )
    return label


def make_readings_label(sensor: SensorLike, provenance: Provenance | None) -> dict[str, Any]:
    """Return the label of readings of several bits. The caller adds the locations of maps.

    Examples
    --------
    >>> make_readings_label(jl.Sensor(bit_depth=4), None)["sensor"]["bit_depth"]
    4
    """
    label = make_bits_label(1, sensor, provenance)
    del label["width"]
    return {**label, "format": READINGS}


def read_readings_label(
    text: str | None,
) -> tuple[dict[str, Any] | None, Provenance | None]:
    """Return the parameters of the sensor and the provenance from a label of readings.

    Both are None when the text is not such a label.

    Raises
    ------
    ValueError
        When the label has another version or an invalid value.
    """
    label = None if text is None or len(text) > MAX_LABEL_BYTES else parse_label(text, READINGS)
    if label is None:
        return None, None
    sensor, provenance = label.get("sensor"), label.get("provenance")
    if label.get("version") != VERSION or not isinstance(sensor, dict) or label.get("maps"):
        raise ValueError(f"label: expected version {VERSION} and a sensor without maps")
    return sensor, None if provenance is None else Provenance.from_json(provenance)


def make_counts_label(trials: int | None, provenance: Provenance | None) -> str:
    """Return the label of an image of counts as JSON."""
    label: dict[str, Any] = {"format": COUNTS, "version": VERSION, "trials": trials}
    return json.dumps({**label, "provenance": None if provenance is None else provenance.to_json()})


def read_counts_label(text: str | None) -> tuple[int | None, Provenance | None]:
    """Return the number of trials and the provenance from the label of an image of counts.

    Both are None when the text is not such a label.

    Raises
    ------
    ValueError
        When the label has another version or an invalid value.

    Examples
    --------
    >>> read_counts_label(make_counts_label(10, None)), read_counts_label("other text")
    ((10, None), (None, None))
    """
    if text is None or len(text) > MAX_LABEL_BYTES:
        return None, None
    label = parse_label(text, COUNTS)
    if label is None:
        return None, None
    trials, provenance = label.get("trials"), label.get("provenance")
    if label.get("version") != VERSION or (trials is not None and type(trials) is not int):
        raise ValueError(f"label: expected version {VERSION} and a whole number of trials")
    if trials is not None and not 1 <= trials < 2**31:
        raise ValueError(f"label: expected 1 to 2**31 - 1 trials, got {trials}")
    return trials, None if provenance is None else Provenance.from_json(provenance)
