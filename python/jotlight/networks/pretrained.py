"""Networks that come with jotlight, trained on photographs; each has a model card beside it."""

from pathlib import Path

from jotlight.networks.architectures import SIZES
from jotlight.networks.network import Network
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

BITS_PER_PIXEL = tuple(side**2 for side in range(3, 11))
"""K of the qualities "two-layer" and "small". All have α = K, q = 1, S = 1 and the box kernel."""

LARGE_BITS_PER_PIXEL = (16,)
"""K of the quality "large", which is alike in all else."""

FOLDER = Path(__file__).parent / "weights"
"""Where they are: `small-k16.safetensors`, for example, with its card `small-k16.md`."""

MOST_BITS = 256
"""K of the network of quality "medium", at most."""

_DARK = 0.05
"""Dark counts per jot and frame whose noise is small beside that of the light."""


def pretrained(sensor: Sensor, quality: str = "medium") -> Network:
    """Give the trained network for a sensor.

    The networks are tied, so that each serves K jots in space, K frames in time, all between, and
    counts.

    Parameters
    ----------
    sensor : Sensor
        With the box kernel. For "medium" 1 to 256 bits per pixel, at any exposure; for the others
        K = 9, 16, 25, 36, 49, 64, 81 or 100 bits per pixel, for "large" 16 alone, ηα = K,
        threshold 1, S = 1, and no more than weak dark counts. Dead jots are allowed.
    quality : {"two-layer", "small", "medium", "large"}
        The paper's two layers; six layers of up to 12 channels; thirteen of up to 52, which are
        told K; or fourteen of up to 80.

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
    >>> pretrained(sensor, "two-layer").reconstruct(bits).shape
    (8, 8)
    """
    if (reason := unsupported_message(sensor, quality)) is not None:
        raise ValueError(reason)
    name = quality if quality == "medium" else f"{quality}-k{sensor.bits_per_pixel}"
    return Network.load(FOLDER / f"{name}.safetensors")


def unsupported_message(sensor: Sensor, quality: str = "medium") -> str | None:
    """Say why there is no trained network for a sensor and how to train one, or None if there is.

    Examples
    --------
    >>> unsupported_message(Sensor(frames=16)) is None
    True
    >>> unsupported_message(Sensor(frames=20), "two-layer").split(": ")[1]
    'jotlight train FOLDER_OF_PHOTOGRAPHS -o model.safetensors --oversampling 1 --frames 20'
    """
    reason = unsupported_reason(sensor, quality)
    return reason and f"{reason}; train one: {training_command(sensor)}"


def unsupported_reason(sensor: Sensor, quality: str = "medium") -> str | None:
    """Say why there is no trained network for a sensor, or None if there is.

    Raises
    ------
    ValueError
        For a quality that there is not.

    Examples
    --------
    >>> print(unsupported_reason(Sensor(frames=16, threshold=2), "two-layer"))
    there is no trained network for the threshold 2, only for 1
    """
    if quality not in SIZES:
        raise ValueError(f"quality: expected one of {', '.join(SIZES)}, got {quality!r}")
    if quality == "medium":
        reason = _beyond_any(sensor)
    else:
        known = LARGE_BITS_PER_PIXEL if quality == "large" else BITS_PER_PIXEL
        reason = _beyond_one(sensor, known)
    return reason and f"there is no trained network for {reason}"


def _beyond_any(sensor: Sensor) -> str | None:
    """Why a network that is told K does not serve a sensor."""
    if not 1 <= sensor.bits_per_pixel <= MOST_BITS:
        return f"{sensor.bits_per_pixel} bits per pixel, only for 1 to {MOST_BITS}"
    if sensor.kernel != "box":
        return f"the {sensor.kernel} kernel, only for the box"
    return None


def _beyond_one(sensor: Sensor, known: tuple[int, ...]) -> str | None:
    """Why networks for one K and exposure do not serve a sensor."""
    efficiency, dark = reference_jot(sensor)
    response = efficiency * sensor.gain / sensor.bits_per_pixel
    if sensor.bits_per_pixel not in known:
        numbers = ", ".join(map(str, known))
        return f"{sensor.bits_per_pixel} bits per pixel, only for {numbers}"
    if sensor.threshold != 1:
        return f"the threshold {sensor.threshold}, only for 1"
    if sensor.kernel != "box":
        return f"the {sensor.kernel} kernel, only for the box"
    if abs(response - 1) > 1e-9:
        return (
            f"{response:.4g} detections per jot and frame at intensity 1 (efficiency * gain / "
            "bits per pixel), only for 1"
        )
    if sensor.max_intensity != 1:
        return f"the largest intensity {sensor.max_intensity:g}, only for 1"
    if dark > _DARK:
        return f"dark counts of {dark:.3g}, only up to {_DARK}"
    return None


def training_command(sensor: Sensor) -> str:
    """Give the command that trains a network for a sensor."""
    options = [f"--oversampling {sensor.oversampling}", f"--frames {sensor.frames}"]
    if sensor.gain != sensor.bits_per_pixel:
        options.append(f"--gain {float(sensor.gain)!r}")
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
