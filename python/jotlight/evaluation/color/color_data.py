"""What the color network takes, and when it estimates an image.

It takes images of a sensor with a mosaic, or with three channels. Data must have the right form
(:func:`takes_mosaic`, :func:`takes_channels`), and a sensor must fit (:func:`takes_sensor`).
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators.demosaicing import COLORS, TITLES
from jotlight.parameter_names import check_choice
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.merged import Merged, is_finer
from jotlight.sensing.sensor import Sensor

BY_COLOR_NETWORK = "network"
"""The `demosaicing` by the color network."""

_MIN_KNOWN = 0.9
"""Fraction of the pixels that must have bits of all colors."""

_TAKEN = (
    "estimates colors without another method: it takes no method, quality, or options, and "
    "no fallback. Its data are bits, readings, or counts with the same trials in all pixels; "
    'demosaicing="differences" takes all data'
)
"""What the color network takes, for messages."""


def takes_sensor(sensor: Sensor) -> bool:
    """Return whether the color network takes the readings of a sensor: the kernel is the box.

    Examples
    --------
    >>> takes_sensor(jl.Sensor(frames=2000)), takes_sensor(jl.Sensor(kernel="cubic"))
    (True, False)
    """
    return sensor.kernel == "box"


def takes_mosaic(data: object, trials: npt.ArrayLike | None = None) -> bool:
    """Return whether data of a sensor with a mosaic have the form that the color network takes.

    Merged counts and maps of trials do not.

    Examples
    --------
    >>> takes_mosaic(np.zeros((4, 4), int), trials=8)
    True
    >>> takes_mosaic(np.zeros((4, 4), int), trials=[[8, 8], [0, 8]])
    False
    """
    each = data if isinstance(data, list | tuple) else [data]
    has_map = trials is not None and np.ndim(trials) > 0
    return not has_map and not any(isinstance(one, Merged) for one in each)


def takes_channels(images: GrayImages) -> bool:
    """Return whether images have the form that the color network takes: red, green, and blue.

    Nearly all pixels of merged counts must have bits of all three.

    Examples
    --------
    >>> from jotlight.layout import Layout
    >>> counts = np.zeros((3, 4, 6), np.int32)
    >>> takes_channels(GrayImages(counts, Layout((3,), -1)))
    True
    >>> takes_channels(GrayImages(counts, Layout((3,))))
    False
    """
    layout = images.layout
    if layout.channel_axis is None or layout.shape[-1] != COLORS:
        return False
    for start in range(0, len(images), COLORS):
        each: Any = images.data[start : start + COLORS]
        if not any(isinstance(one, Merged) for one in each):
            continue
        if any(is_finer(one) for one in each):
            return False
        known = [np.broadcast_to(one.trials, one.shape) > 0 for one in each]
        if np.mean(np.all(known, axis=0)) < _MIN_KNOWN:
            return False
    return True


def check_taken(sensor: Sensor, *, has_form: bool) -> None:
    """Raise ValueError unless a color network that the caller requests can estimate the image.

    `has_form` states whether the data have a form that it takes.

    Examples
    --------
    >>> check_taken(jl.Sensor(frames=16, mosaic="RGGB"), has_form=True)
    >>> check_taken(jl.Sensor(frames=16, kernel="cubic"), has_form=True)
    Traceback (most recent call last):
      ...
    ValueError: method: a color network takes bits of ...
    """
    if not (has_form and takes_sensor(sensor)):
        got = "other data" if takes_sensor(sensor) else f"the kernel {sensor.kernel}"
        raise ValueError(
            "method: a color network takes bits of a sensor with a mosaic, with the same trials in "
            "all pixels, or of three channels (channel_axis=-1 for counts), with the box kernel; "
            f"got {got}; name another method"
        )


def check_demosaicing(demosaicing: str | None, sensor: Sensor | None = None) -> None:
    """Raise ValueError for an unknown `demosaicing`, or one for a sensor without a mosaic.

    Examples
    --------
    >>> check_demosaicing("network")
    >>> check_demosaicing("network", jl.Sensor(frames=16))
    Traceback (most recent call last):
      ...
    ValueError: demosaicing: is for a sensor with a mosaic, such as Sensor(mosaic='RGGB')
    """
    names = BY_COLOR_NETWORK, *TITLES
    if demosaicing is not None:
        check_choice("demosaicing", demosaicing, names)
    if demosaicing is not None and sensor is not None and sensor.mosaic is None:
        raise ValueError(
            "demosaicing: is for a sensor with a mosaic, such as Sensor(mosaic='RGGB')"
        )


def check_color_network(demosaicing: str | None, *, is_default: bool) -> None:
    """Raise ValueError if `demosaicing` requests the color network where it cannot be used.

    `is_default` states whether no method and no options are requested, and :func:`takes_mosaic`
    accepts the data.

    Examples
    --------
    >>> check_color_network("network", is_default=True)
    >>> check_color_network("network", is_default=False)
    Traceback (most recent call last):
      ...
    ValueError: demosaicing: "network" estimates colors without another method: it takes no ...
    """
    if demosaicing == BY_COLOR_NETWORK and not is_default:
        raise ValueError(f'demosaicing: "network" {_TAKEN}')
