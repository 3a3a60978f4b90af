"""Captures whose mosaic the caller states."""

from typing import TypeVar

from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.contradictions import warn_about_contradictions
from jotlight.sensing.sensor import Sensor

AnyBits = TypeVar("AnyBits", Bits, Readings)


def with_mosaic(data: AnyBits, mosaic: object) -> AnyBits:
    """Return bits or readings whose sensor has a mosaic; None leaves them as they are.

    Parameters
    ----------
    data : Bits or Readings
        The data. Bits without a sensor get one with their frames.
    mosaic : str, array_like, Mosaic, or None
        The mosaic, as :class:`jotlight.Sensor` takes it.

    Raises
    ------
    ValueError
        When the mosaic does not fit the data.

    Warns
    -----
    JotlightWarning
        When the data state another mosaic.

    Examples
    --------
    >>> with_mosaic(jl.Bits.from_array([[[0, 1], [1, 1]]]), "RGGB").sensor
    Sensor(mosaic=Mosaic('RGGB'))
    """
    if mosaic is None:
        return data
    if len(data.shape) != 3:
        raise ValueError(
            "mosaic: expected gray frames (T, H, W), because the pixels of a mosaic have one color "
            f"each, got frames of shape {data.shape}; leave out the mosaic"
        )
    stated = data.sensor
    known = stated if isinstance(stated, Sensor) else Sensor(frames=len(data))
    sensor = known.replace(mosaic=mosaic, gain=known.gain)
    warn_about_contradictions(data, sensor, "mosaic")
    if isinstance(data, Readings):
        return Readings(data.frames, sensor, data.provenance)
    return data.replace(sensor=sensor)
