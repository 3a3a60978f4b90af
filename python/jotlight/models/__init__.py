"""Networks that come with jotlight, trained on photographs; each has a model card beside it."""

from pathlib import Path

from jotlight.mle import reference_jot
from jotlight.network import Network
from jotlight.sensor import Sensor

BITS_PER_PIXEL = tuple(side**2 for side in range(3, 11))
"""K of the trained networks. All have α = K, q = 1, S = 1 and the box kernel."""

FOLDER = Path(__file__).parent
"""Where they are: `k16.safetensors`, say, with its card `k16.md`."""

_DARK = 0.05
"""Dark counts per jot and frame whose noise is small beside that of the light."""


def pretrained(sensor: Sensor) -> Network:
    """Give the trained network for a sensor.

    The networks are tied, so that each serves K jots in space, K frames in time, all between, and
    counts.

    Parameters
    ----------
    sensor : Sensor
        With K = 9, 16, 25, 36, 49, 64, 81 or 100 bits per pixel, ηα = K, threshold 1, S = 1, the
        box kernel and no more than weak dark counts. Dead jots are allowed.

    Returns
    -------
    Network

    Raises
    ------
    ValueError
        When there is none for this sensor; the message says why, and how to train one.

    Notes
    -----
    Data with dark counts or dead jots go to ``reconstruct(data, sensor)`` with their sensor, where
    they do not carry it.

    Examples
    --------
    >>> import numpy as np
    >>> sensor = Sensor(oversampling=2, frames=4)
    >>> bits = sensor.expose(np.full((8, 8), 0.5), rng=0)
    >>> pretrained(sensor).reconstruct(bits).shape
    (8, 8)
    """
    if (reason := lacking(sensor)) is not None:
        raise ValueError(reason)
    return Network.load(FOLDER / f"k{sensor.bits_per_pixel}.safetensors")


def lacking(sensor: Sensor) -> str | None:
    """Say why there is no trained network for a sensor and how to train one, or None if there is.

    Examples
    --------
    >>> lacking(Sensor(frames=16)) is None
    True
    >>> lacking(Sensor(frames=20)).split(": ")[1]
    'jotlight train FOLDER_OF_PHOTOGRAPHS -o model.safetensors --oversampling 1 --frames 20'
    """
    reason = unserved(sensor)
    return reason and f"{reason}; train one: {training_command(sensor)}"


def unserved(sensor: Sensor) -> str | None:
    """Say why there is no trained network for a sensor, or None if there is.

    Examples
    --------
    >>> print(unserved(Sensor(frames=16, threshold=2)))
    there is no trained network for the threshold 2, only for 1
    """
    efficiency, dark = reference_jot(sensor)
    response = efficiency * sensor._gain / sensor.bits_per_pixel
    if sensor.bits_per_pixel not in BITS_PER_PIXEL:
        known = ", ".join(map(str, BITS_PER_PIXEL))
        reason = f"{sensor.bits_per_pixel} bits per pixel, only for {known}"
    elif sensor.threshold != 1:
        reason = f"the threshold {sensor.threshold}, only for 1"
    elif sensor.kernel != "box":
        reason = f"the {sensor.kernel} kernel, only for the box"
    elif abs(response - 1) > 1e-9:
        reason = (
            f"{response:.4g} detections per jot and frame at intensity 1 (efficiency * gain / "
            "bits per pixel), only for 1"
        )
    elif sensor.max_intensity != 1:
        reason = f"the largest intensity {sensor.max_intensity:g}, only for 1"
    elif dark > _DARK:
        reason = f"dark counts of {dark:.3g}, only up to {_DARK}"
    else:
        return None
    return f"there is no trained network for {reason}"


def training_command(sensor: Sensor) -> str:
    """Give the command that trains a network for a sensor."""
    options = [f"--oversampling {sensor.oversampling}", f"--frames {sensor.frames}"]
    if sensor._gain != sensor.bits_per_pixel:
        options.append(f"--gain {float(sensor._gain)!r}")
    if sensor.threshold != 1:
        options.append(f"--threshold {sensor.threshold}")
    if sensor.kernel != "box":
        options.append(f"--kernel {sensor.kernel}")
    efficiency, dark = reference_jot(sensor)
    if dark:
        options.append(f"--dark-counts {float(dark)!r}")
    if efficiency != 1:
        options.append(f"--efficiency {float(efficiency)!r}")
    if sensor.max_intensity != 1:
        options.append(f"--max-intensity {float(sensor.max_intensity)!r}")
    return f"jotlight train FOLDER_OF_PHOTOGRAPHS -o model.safetensors {' '.join(options)}"
