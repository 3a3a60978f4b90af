"""What the page shows about a capture: its sensor, its provenance, and its methods."""

from typing import Any

import numpy as np

from jotlight._engine import __version__
from jotlight.errors import plural
from jotlight.evaluation.choice import TITLES
from jotlight.evaluation.methods import COLOR_NETWORK, METHODS
from jotlight.images.tone import CURVES
from jotlight.sensing.sensor import Sensor
from jotlight.view.alignment import alignment_reason
from jotlight.view.counted import counted_by
from jotlight.view.estimate import choose, recommend
from jotlight.view.state import COUNTS
from jotlight.view.viewed import Viewable, whole_cycles

_WINDOW = 64
"""Number of frames of the first image."""

_HIDDEN = {"mle-iterative", "network-initial"}
"""Methods that the page leaves out: another way to the same estimate, and an untrained network."""

_SENSOR_TEXTS = {
    "oversampling": "oversampling K̂",
    "gain": "gain α per frame",
    "threshold": "threshold q",
    "bit_depth": "bits of a reading b",
    "read_noise": "read noise σ",
    "kernel": "kernel g",
    "mosaic": "mosaic",
    "dark_counts": "dark counts d",
    "efficiency": "efficiency η",
    "mask": "dead jots",
    "exposure_time": "exposure time",
    "max_intensity": "largest intensity S",
}

_HIDDEN_VALUES = {"bit_depth": 1, "read_noise": 0.0}
"""Values of parameters that most sensors have, which are not listed."""

_MAX_VALUES = 8
"""Maximum number of values of a cycle that are listed."""


def describe_capture(viewed: Viewable) -> dict[str, Any]:
    """Return all that the page shows about a capture, as values of JSON."""
    window = whole_cycles(viewed, max(1, min(_WINDOW, len(viewed.frames))))
    recommended = recommend(viewed, window).method
    provenance, sensor = viewed.provenance, viewed.sensor(viewed.cycle)
    lines = [] if provenance is None else [str(provenance), *provenance.describe()]
    return {
        "software": f"jotlight {__version__}",
        "title": viewed.title,
        "cycle": viewed.cycle,
        "mean_reading": counted_by(sensor).mean,
        "align_reason": alignment_reason(viewed),
        "live": viewed.is_live,
        **{name: value for name, value in viewed.facts().items() if name != "rates"},
        "sensor": describe_sensor(viewed),
        "sensor_note": viewed.sensor_note,
        "provenance": lines,
        "methods": _methods(viewed, window, recommended),
        "curves": list(CURVES),
        "recommended": recommended,
        # Maximum likelihood follows a live capture without delay.
        "state": {"window": window, "method": "mle" if viewed.is_live else recommended},
    }


def describe_sensor(viewed: Viewable) -> list[list[str]]:
    """Return the names and the values of a sensor's parameters for one frame, as texts.

    Exposures and thresholds that repeat have the values of a cycle.
    """
    sensor = viewed.sensor(viewed.cycle)
    height, width, *channels = viewed.shape
    side = sensor.oversampling
    jots = " × ".join(map(str, (height * side, width * side, *channels)))
    rows = [["jots", jots]]
    for name, text in _SENSOR_TEXTS.items():
        value = getattr(sensor, name)
        if name == "max_intensity" and not viewed.is_range_known:
            continue
        is_usual = np.ndim(value) == 0 and value == _HIDDEN_VALUES.get(name)
        if value is not None and not is_usual:
            rows.append([text, _describe(name, value, sensor)])
    return rows


def _describe(name: str, value: Any, sensor: Sensor) -> str:
    if name == "mask":
        return f"{int(np.count_nonzero(value))} of {value.size}"
    if name == "exposure_time":
        return f"{value:.4g} s"
    if name in ("gain", "threshold") and np.ndim(value) == 1:
        more = ", …" if len(value) > _MAX_VALUES else ""
        unit = " photons" if name == "gain" else ""
        return ", ".join(f"{each:.4g}" for each in value[:_MAX_VALUES]) + more + unit
    if name == "gain":
        return _photons(sensor.gain / sensor.frames)
    if name == "read_noise":
        return _photons(value)
    if isinstance(value, np.ndarray):
        return f"map, median {float(np.median(value)):.3g}"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _methods(viewed: Viewable, window: int, recommended: str) -> list[dict[str, Any]]:
    """Return the methods for the page, each with the reason why it cannot be used, if any."""
    sensor = viewed.sensor(window)
    methods: list[dict[str, Any]] = [{"name": COUNTS, "title": counted_by(sensor).title}]
    if recommended == COLOR_NETWORK:
        methods.append({"name": COLOR_NETWORK, "title": TITLES[COLOR_NETWORK], "quality": "color"})
    for name, method in METHODS.items():
        if name in _HIDDEN:
            continue
        entry: dict[str, Any] = {"name": name, "title": method.title}
        if method.quality is not None:
            entry["quality"] = method.quality
        if not method.available:
            entry["reason"] = f"needs the package {method.required_package}"
        elif reason := method.unsupported_reason(sensor):
            entry["reason"] = reason
        else:
            try:
                choose(viewed, window, name)
            except ValueError as error:
                entry["reason"] = str(error)
        methods.append(entry)
    return methods


def _photons(number: float) -> str:
    text = f"{number:.4g}"
    return f"{text} {plural(float(text), 'photon')}"
