"""The trained networks that come with jotlight; each file has a model card beside it."""

from pathlib import Path

from jotlight.networks.architectures import SIZES
from jotlight.networks.network import Network
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

CONDITIONAL_SIZE = "medium"
"""The default size. It is K-conditioned: its network serves any K, exposure, and S."""

CONDITIONAL_SIZES = CONDITIONAL_SIZE, "large"
"""The K-conditioned sizes."""

TRAINED_TRIALS = tuple(side**2 for side in range(3, 11))
"""Values of K of the "two-layer" and "small" networks, for α = K, q = 1, S = 1, and box kernel."""

LARGE_TRIALS = (16,)
"""Values of K for which there is also a "large" network for this K alone, which is better, for the
same α, q, S, and kernel."""

MAX_TRIALS = 256
"""Largest K on which the K-conditioned networks were trained."""

FOLDER = Path(__file__).parent / "weights"
"""Folder of the files: `small-k16.safetensors`, for example, with its card `small-k16.md`."""

_MAX_DARK_COUNTS = 0.05
"""Largest dark counts per jot and frame that networks for one K serve.

The noise of such dark counts is small compared with that of the light.
"""


def pretrained(sensor: Sensor, quality: str = "medium") -> Network:
    """Return the trained network for a sensor.

    The networks are tied. So each serves every combination of jots and frames with K bits per
    pixel, and counts.

    Parameters
    ----------
    sensor : Sensor
        Sensor with the box kernel. Dead jots are allowed. "medium" and "large" serve every number
        of trials per pixel at any exposure. The other sizes serve K = 9, 16, 25, 36, 49, 64, 81, or
        100, ηα = K, threshold 1, S = 1, and dark counts of at most 0.05.
    quality : {"two-layer", "small", "medium", "large"}
        Size of the network. In this order: the paper's two layers; six layers of up to 12 channels;
        thirteen K-conditioned layers of up to 52 channels; fifteen of up to 80 channels. For K = 16
        and the sensors of the smaller sizes, "large" is a network for this K alone.

    Returns
    -------
    Network
        Counts without a sensor of their own are those of `sensor`.

    Raises
    ------
    TypeError
        When `sensor` is no sensor.
    ValueError
        When no trained network of this size serves the sensor; the message says why, and what to
        do.

    Examples
    --------
    >>> import numpy as np
    >>> sensor = Sensor(oversampling=2, frames=4)
    >>> bits = sensor.expose(np.full((8, 8), 0.5), rng=0)
    >>> pretrained(sensor, "two-layer").reconstruct(bits).shape
    (8, 8)
    """
    if not isinstance(sensor, Sensor):
        raise TypeError(
            "sensor: expected a jotlight.Sensor, such as Sensor(frames=16), got "
            f"{sensor!r}; pretrained(sensor, 'large') selects a size"
        )
    if (message := unsupported_message(sensor, quality)) is not None:
        raise ValueError(message)
    network = Network.load(pretrained_file(sensor, quality))
    network.default_sensor = sensor
    return network


def pretrained_file(sensor: Sensor, quality: str = "medium") -> Path:
    """Return the file of the network of a size that serves a sensor.

    Examples
    --------
    >>> pretrained_file(Sensor(frames=16), "small").name
    'small-k16.safetensors'
    """
    is_conditional = quality in CONDITIONAL_SIZES
    if quality == "large" and _unsupported_by_one_exposure(sensor, LARGE_TRIALS) is None:
        is_conditional = False
    name = quality if is_conditional else f"{quality}-k{sensor.trials}"
    return FOLDER / f"{name}.safetensors"


def unsupported_message(sensor: Sensor, quality: str = "medium") -> str | None:
    """Return why no trained network serves a sensor and what to do, or None if one does.

    Examples
    --------
    >>> unsupported_message(Sensor(frames=16)) is None
    True
    >>> unsupported_message(Sensor(frames=20), "two-layer").split("; ")[1]
    'quality="medium" (--quality medium) serves this sensor'
    """
    reason = unsupported_reason(sensor, quality)
    return reason and f"{reason}; {remedy(sensor)}"


def remedy(sensor: Sensor, training: str | None = None) -> str:
    """Return what to do when the trained networks of a size do not serve a sensor.

    Parameters
    ----------
    sensor : Sensor
        Sensor of the data.
    training : str, optional
        Advice to train a network, for a sensor that no size serves. Default: the command.
    """
    if _unsupported_by_conditional(sensor) is None:
        return f'quality="{CONDITIONAL_SIZE}" (--quality {CONDITIONAL_SIZE}) serves this sensor'
    return training or f"train one with PyTorch: {training_command(sensor)}"


def unsupported_reason(sensor: Sensor, quality: str = "medium") -> str | None:
    """Return why no trained network serves a sensor, or None if one does.

    Raises
    ------
    ValueError
        For an unknown quality.

    Examples
    --------
    >>> print(unsupported_reason(Sensor(frames=16, threshold=2), "two-layer"))
    there is no trained network for the threshold 2, only for 1
    """
    if quality not in SIZES:
        raise ValueError(f"quality: expected one of {', '.join(SIZES)}, got {quality!r}")
    if quality in CONDITIONAL_SIZES:
        reason = _unsupported_by_conditional(sensor)
    else:
        reason = _unsupported_by_one_exposure(sensor, TRAINED_TRIALS)
    return reason and f"there is no trained network for {reason}"


def _unsupported_by_conditional(sensor: Sensor) -> str | None:
    """Return the property of a sensor that K-conditioned networks do not serve, or None."""
    if sensor.kernel != "box":
        return f"the {sensor.kernel} kernel, only for the box"
    return None


def _unsupported_by_one_exposure(sensor: Sensor, trained: tuple[int, ...]) -> str | None:
    """Return the property of a sensor that networks for a single exposure do not serve, or None."""
    efficiency, dark_counts = reference_jot(sensor)
    detections = efficiency * sensor.gain / sensor.trials
    if sensor.trials not in trained:
        numbers = ", ".join(map(str, trained))
        return f"{sensor.trials} trials per pixel, only for {numbers}"
    if sensor.threshold != 1:
        return f"the threshold {sensor.threshold}, only for 1"
    if sensor.kernel != "box":
        return f"the {sensor.kernel} kernel, only for the box"
    if abs(detections - 1) > 1e-9:
        return (
            f"{detections:.4g} detections per jot and frame at intensity 1 (efficiency * gain / "
            "trials per pixel), only for 1"
        )
    if sensor.max_intensity != 1:
        return f"the largest intensity {sensor.max_intensity:g}, only for 1"
    if dark_counts > _MAX_DARK_COUNTS:
        return f"dark counts of {dark_counts:.3g}, only up to {_MAX_DARK_COUNTS}"
    return None


def training_command(sensor: Sensor) -> str:
    """Return the command that trains a deep network for a sensor.

    Examples
    --------
    >>> print(training_command(Sensor(kernel="cubic")).partition(" -o ")[2])
    model.safetensors --quality medium --oversampling 1 --frames 1 --kernel cubic
    """
    options = [f"--quality {CONDITIONAL_SIZE}"]
    options += [f"--oversampling {sensor.oversampling}", f"--frames {sensor.frames}"]
    if sensor.gain != sensor.trials:
        options.append(f"--gain {float(sensor.gain)!r}")
    if sensor.threshold != 1:
        options.append(f"--threshold {sensor.threshold}")
    if sensor.kernel != "box":
        options.append(f"--kernel {sensor.kernel}")
    efficiency, dark_counts = reference_jot(sensor)
    if dark_counts:
        options.append(f"--dark-counts {float(dark_counts)!r}")
    if efficiency != 1:
        options.append(f"--efficiency {float(efficiency)!r}")
    if sensor.max_intensity != 1:
        options.append(f"--max-intensity {float(sensor.max_intensity)!r}")
    return f"jotlight train FOLDER_OF_PHOTOGRAPHS -o model.safetensors {' '.join(options)}"
