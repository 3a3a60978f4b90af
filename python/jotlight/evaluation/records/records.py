"""What an image was made of, and how: the facts that its record states."""

import hashlib
from typing import Any

from jotlight._engine import __version__
from jotlight.images.tone import Tone
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor

FORMAT = "jotlight record"
"""Value of "format" in a record beside a result."""


def image_facts(
    sensor: Sensor, method: str, provenance: Provenance | None, *, units: str, largest_value: float
) -> dict[str, Any]:
    """Return the software, the sensor, the method, and how the capture was read.

    Parameters
    ----------
    sensor : Sensor
        The sensor of the image.
    method : str
        The name of the method.
    provenance : Provenance or None
        That of the frames of the image.
    units : str
        Units of the values, in words.
    largest_value : float
        The largest possible value, in these units.

    Examples
    --------
    >>> facts = image_facts(jl.Sensor(frames=4), "mle", None, units="intensity", largest_value=1.0)
    >>> facts["method"], facts["sensor"]["frames"]
    ('mle', 4)
    """
    return {
        "software": f"jotlight {__version__}",
        "units": units,
        "largest_value": largest_value,
        "method": method,
        "sensor": {**sensor.scalars(), **dict.fromkeys(sensor.maps(), "a map")},
        "provenance": None if provenance is None else provenance.to_json(),
    }


def tone_facts(tone: Tone | None) -> dict[str, Any]:
    """Return the curve and the white of an image for display, or {} for floats.

    Examples
    --------
    >>> tone_facts(Tone("linear", 2.0)), tone_facts(None)
    ({'curve': 'linear', 'white': 2.0}, {})
    """
    return {} if tone is None else {"curve": tone.curve, "white": float(tone.white)}


def maps_sha256(sensor: Sensor) -> dict[str, str]:
    """Return the SHA-256 of the values of each map of a sensor, by name."""
    maps = sensor.maps().items()
    return {name: hashlib.sha256(map_.tobytes()).hexdigest() for name, map_ in maps}
