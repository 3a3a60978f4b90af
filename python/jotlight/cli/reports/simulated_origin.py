"""The origin of results that are made of simulated bits: scores and comparisons."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jotlight._engine import __version__
from jotlight.evaluation.records.records import maps_sha256
from jotlight.formats.files.checksums import file_checksum
from jotlight.sensing.sensor import Sensor


def simulated_origin(
    photographs: str,
    sensor: Sensor,
    method: str | list[str],
    model: Path | None,
    options: Mapping[str, object],
) -> dict[str, Any]:
    """Return what a result of simulated bits was made of, and how.

    Parameters
    ----------
    photographs : str
        The photographs in words.
    sensor : Sensor
        The sensor that exposed them.
    method : str or list of str
        The names of the methods.
    model : Path or None
        The file of the user's network.
    options : mapping of str
        Further options. Those that were not set, None or False, are left out.

    Examples
    --------
    >>> origin = simulated_origin("a.png", jl.Sensor(), "mle", None, {"seed": 0, "gray": False})
    >>> origin["method"], origin["options"]
    ('mle', {'seed': 0})
    """
    stated = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in options.items()
        if value is not None and value is not False
    }
    return {
        "software": f"jotlight {__version__}",
        "photographs": photographs,
        "method": method,
        "options": stated,
        "model": model and model.name,
        "weights_sha256": model and file_checksum(model),
        "sensor": {**sensor.scalars(), **dict.fromkeys(sensor.maps(), "a map")},
        "maps_sha256": maps_sha256(sensor),
    }
