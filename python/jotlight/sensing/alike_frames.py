"""The check that all frames of a sensor show a scene alike, as motion, films, and windows need."""

import numpy as np

from jotlight.sensing.readings import GroupedSensor, require_plain_bits, without_mosaic

_ADVICE = (
    "jotlight.reconstruct makes one image of all frames; motion, films, and the viewer take "
    "frames of one gain and threshold"
)


def require_one_exposure(sensor: GroupedSensor) -> None:
    """Raise ValueError unless all readings have one gain and threshold. They may have several bits.

    Examples
    --------
    >>> from jotlight.sensing.sensor import Sensor
    >>> require_one_exposure(Sensor(frames=4, bit_depth=3, read_noise=0.2))
    """
    require_alike_frames(sensor.replace(bit_depth=1, read_noise=0.0, gain=sensor.gain))


def require_alike_frames(sensor: GroupedSensor) -> None:
    """Raise ValueError unless readings are single bits of one gain and threshold, without noise.

    The sensor may have a mosaic. For a bracket, the message names the frames of its first part.

    Examples
    --------
    >>> from jotlight.sensing.sensor import Sensor
    >>> require_alike_frames(Sensor(frames=4, mosaic="RGGB"))
    >>> require_alike_frames(Sensor(frames=4, gain=[8.0, 8.0, 1.0, 1.0]))
    Traceback (most recent call last):
      ...
    ValueError: sensor: expected one gain ... threshold, such as bits[:2] (--frame-range 0:2)
    """
    per_frame = [
        each for each in map(np.asarray, (sensor.gain, sensor.threshold)) if each.ndim == 1
    ]
    advice = _ADVICE
    if per_frame:
        differ = np.any([each != each[0] for each in per_frame], axis=0)
        first = int(np.argmax(differ))
        advice += f", such as bits[:{first}] (--frame-range 0:{first})"
    require_plain_bits(without_mosaic(sensor), advice)
