"""The files of the networks that a method runs, for records."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from jotlight.evaluation.choice import FILM_NETWORK
from jotlight.evaluation.methods import BLEND_METHOD
from jotlight.formats.files.checksums import file_checksum
from jotlight.networks.color.mosaic_planes import plane_sensors
from jotlight.networks.pretrained import (
    CHANNELS_FILE,
    COLOR_START,
    DEFAULT_SIZE,
    FILM_FILE,
    FILM_START,
    MOSAIC_FILE,
    pretrained_file,
)
from jotlight.sensing.sensor import Sensor


def weight_files(
    sensors: Sequence[Sensor],
    method: str,
    quality: str | None,
    *,
    model: Path | None = None,
    is_conditional: bool = False,
    is_color: bool = False,
) -> set[Path]:
    """Return the files of the networks that a method runs.

    Parameters
    ----------
    sensors : sequence of Sensor
        The sensors of the data, such as one with a mosaic, and one without it for merged counts.
        The planes of a mosaic may have different networks.
    method, quality : str
        The method and the size of its network, as a ``jotlight.evaluation.choice.Choice`` states
        them.
    model : Path, optional
        File of the caller's network, for methods without a size.
    is_conditional : bool
        Whether the network must be K-conditioned, as it falls back to other methods.
    is_color : bool
        Whether the colors of an image are estimated together.

    Returns
    -------
    set of Path
        The color network and the film network have two files: their own, and that of the gray
        network at which they start. A blend has those of its gray network, too. Other methods may
        have none.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=16, mosaic="RGGB")
    >>> len(weight_files([sensor], "network-color", None, is_color=True))
    2
    >>> len(weight_files([sensor], "held-out", None, is_color=True))
    3
    >>> len(weight_files([jl.Sensor()], "network-film", None))
    2
    >>> weight_files([sensor], "mle", None)
    set()
    """
    is_blend = method == BLEND_METHOD
    size = DEFAULT_SIZE if is_blend else quality
    files = set[Path]()
    for sensor in sensors:
        if is_color:
            files.add(CHANNELS_FILE if sensor.mosaic is None else MOSAIC_FILE)
            files.add(pretrained_file(sensor, COLOR_START, is_conditional=True))
        if method == FILM_NETWORK:
            files |= {FILM_FILE, pretrained_file(sensor, FILM_START, is_conditional=True)}
        elif size is not None:
            files |= {
                pretrained_file(each, size, is_conditional=is_conditional or is_blend)
                for each in plane_sensors(sensor)
            }
        elif model is not None:
            files.add(model)
    return files


def weights_sha256(files: Iterable[Path]) -> str | list[str] | None:
    """Return the SHA-256 of files of networks, as records state them.

    It is 64 hexadecimal digits, a sorted list of them for several files, or None without a file.

    Raises
    ------
    OSError
        When a file cannot be read.

    Examples
    --------
    >>> len(weights_sha256(weight_files([jl.Sensor()], "network-small", "small")))
    64
    """
    weights = sorted(map(file_checksum, files))
    return weights[0] if len(weights) == 1 else weights or None
