"""The warning about a sensor that contradicts the one that the data carry."""

from typing import Any

import numpy as np

from jotlight.errors import JotlightWarning, PeriodicRatesWarning, warn
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.data_lists import list_of_data
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.sensor import Sensor

_LISTED = 4
"""Number of values of a bracket that a message lists."""

_MAX_RELATIVE = 1e-3
"""Largest difference of equal ratios of gains, which a caller may have rounded."""


def warn_about_contradictions(
    data: object, sensor: object, argument: str = "sensor", *, is_required: bool = False
) -> list[str]:
    """Warn if a sensor contradicts the one that the data carry. Return the parameters that do.

    These are the threshold, the mosaic, and the ratios of the gains of frames. Callers may know
    other parameters better than the data do, such as dark counts or the largest intensity, or
    choose them. With the box kernel, they choose the mean light of each pixel.

    Parameters
    ----------
    data : Bits, Readings, Merged, list of them, or other data
        The data. Data without a sensor are not compared.
    sensor : Sensor or None
        The sensor that is used in place of their own.
    argument : str
        The argument of the caller that states it, for the message.
    is_required : bool
        Whether callers must pass this argument, so that they cannot leave it out.

    Examples
    --------
    >>> bits = jl.Sensor(frames=2, threshold=2).expose(np.ones((8, 8)), rng=0)
    >>> warn_about_contradictions(bits, bits.sensor.replace(max_intensity=4.0, dark_counts=0.1))
    []
    """
    first: Any = next(iter(list_of_data(data)), data)
    stated = first.sensor if isinstance(first, Bits | Readings | Merged) else None
    if not isinstance(stated, Sensor) or not isinstance(sensor, Sensor) or stated is sensor:
        return []
    if isinstance(first, Merged) and not sensor.has_plain_bits:
        return []  # refused elsewhere
    # Merged counts state no mosaic.
    height, width = (0, 0) if isinstance(first, Merged) else first.shape[1:3]
    found = contradictions(stated, sensor, (height, width))
    if found:
        own, other = (
            " and ".join(_text(name, each) for name in found) for each in (stated, sensor)
        )
        verb = "is" if len(found) == 1 else "are"
        is_gray = found == ["mosaic"] and sensor.mosaic is None
        options = ", ".join(f"--{name}" for name in found)
        advice = f"leave out {argument}= ({options})"
        if is_required:
            advice = f"pass the {argument} of the data"
        warn(
            f"{' and '.join(found)}: the data state {own}, but {other} {verb} used instead; "
            f"{advice} unless the data are wrong",
            PeriodicRatesWarning if is_gray else JotlightWarning,
        )
    return found


def contradictions(stated: Sensor, sensor: Sensor, size: tuple[int, int]) -> list[str]:
    """Return the names of the parameters of a sensor that contradict those of another one.

    Parameters
    ----------
    stated : Sensor
        The sensor of the data.
    sensor : Sensor
        The other one.
    size : tuple of int
        Height and width of the data in jots.

    Examples
    --------
    >>> bracket = jl.Sensor(frames=2, gain=[1.0, 8.0], mosaic="RGGB")
    >>> contradictions(bracket, bracket.replace(gain=[2.0, 16.0], max_intensity=4.0), (8, 8))
    []
    >>> contradictions(bracket, jl.Sensor(frames=2, threshold=2), (8, 8))
    ['threshold', 'gain', 'mosaic']
    """
    differ = {
        "threshold": _differ(stated.threshold, sensor.threshold),
        "gain": _differ(_ratios(stated), _ratios(sensor)),
        "mosaic": _mosaics_differ(stated, sensor, size),
    }
    return [name for name, value in differ.items() if value]


def _differ(first: Any, second: Any) -> bool:
    """Return whether values differ. Those for other numbers of frames are refused elsewhere."""
    dimensions = {np.ndim(first), np.ndim(second)}
    if len(dimensions - {0}) > 1:
        return True  # one for each frame, and one for each jot
    if 0 not in dimensions and np.shape(first) != np.shape(second):
        return False
    return not np.allclose(first, second, rtol=_MAX_RELATIVE, atol=0)


def _ratios(sensor: Sensor) -> Any:
    """Return the gains of frames relative to their mean; 1 for frames of one gain."""
    gain: Any = sensor.gain
    return gain / gain.mean() if isinstance(gain, np.ndarray) else 1.0


def _mosaics_differ(stated: Sensor, sensor: Sensor, size: tuple[int, int]) -> bool:
    """Return whether pixels have other filters. A mosaic may be added to data that state none."""
    own: Mosaic | None = stated.mosaic
    other: Mosaic | None = sensor.mosaic
    if own is None or other is None:
        return own is not None
    if own.filters == other.filters and np.array_equal(own.pattern, other.pattern):
        return False
    try:
        ours, others = (
            np.array(list(each.mosaic.filters))[each.mosaic.of_jots(*size, each.oversampling)]
            for each in (stated, sensor)
        )
    except ValueError:  # a map of another size, which is refused elsewhere
        return False
    return not np.array_equal(ours, others)


def _text(name: str, sensor: Sensor) -> str:
    value: Any = getattr(sensor, name)
    if name == "mosaic":
        return "no mosaic" if value is None else f"the mosaic {value!r}"
    if isinstance(value, np.ndarray):
        each = "frame" if value.ndim == 1 else "jot"
        if value.ndim > 1:
            return f"a {name} for each {each}"
        listed = [f"{one:g}" for one in value[:_LISTED]] + ["..."] * (len(value) > _LISTED)
        return f"a {name} for each {each} ({', '.join(listed)})"
    return "one gain for all frames" if name == "gain" else f"{name} {value}"
