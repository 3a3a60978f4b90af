"""The origin of results that are made of simulated bits: scores and comparisons."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jotlight._engine import __version__
from jotlight.evaluation.methods import BLEND_METHOD, COLOR_NETWORK, METHOD_NAMES, METHODS
from jotlight.evaluation.records.records import maps_sha256
from jotlight.evaluation.records.weights import weight_files, weights_sha256
from jotlight.formats.files.checksums import file_checksum
from jotlight.sensing.sensor import Sensor


def simulated_origin(
    photographs: str,
    files: Sequence[Path],
    sensor: Sensor,
    method: str | list[str],
    model: Path | None,
    options: Mapping[str, object],
    *,
    is_color: bool = False,
) -> dict[str, Any]:
    """Return what a result of simulated bits was made of, and how.

    Parameters
    ----------
    photographs : str
        The photographs in words.
    files : sequence of Path
        Their files, if they are files.
    sensor : Sensor
        The sensor that exposed them.
    method : str or list of str
        The names of the methods, or titles of methods of the user.
    model : Path or None
        The file of the user's network.
    options : mapping of str
        Further options. Those that were not set, None or False, are left out.
    is_color : bool
        Whether the photographs have three channels.

    Raises
    ------
    OSError
        When a file cannot be read.

    Examples
    --------
    >>> origin = simulated_origin("a", [], jl.Sensor(), "mle", None, {"seed": 0, "gray": False})
    >>> origin["method"], origin["options"]
    ('mle', {'seed': 0})
    """
    stated = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in options.items()
        if value is not None and value is not False
    }
    networks = set() if model is None else {model}
    for name in [method] if isinstance(method, str) else method:
        if name in METHOD_NAMES:
            quality = METHODS[name].quality if name in METHODS else None
            is_joint = is_color and name in (COLOR_NETWORK, BLEND_METHOD)
            networks |= weight_files([sensor], name, quality, is_color=is_joint)
    return {
        "software": f"jotlight {__version__}",
        "photographs": photographs,
        "photographs_sha256": _joint_checksum(files),
        "method": method,
        "options": stated,
        "model": model and model.name,
        "weights_sha256": weights_sha256(networks),
        "sensor": {**sensor.scalars(), **dict.fromkeys(sensor.maps(), "a map")},
        "maps_sha256": maps_sha256(sensor),
    }


def _joint_checksum(files: Sequence[Path]) -> str | None:
    """Return the SHA-256 of a file, or that of the SHA-256 of several files, one after another."""
    checksums = [file_checksum(file) for file in files]
    if len(checksums) > 1:
        return hashlib.sha256("".join(checksums).encode()).hexdigest()
    return checksums[0] if checksums else None
