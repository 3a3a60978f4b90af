"""The trained networks that come with jotlight; each file has a model card beside it."""

from pathlib import Path
from typing import Any, TypeVar

from jotlight.networks.architectures import EXTRA_LARGE, QUALITIES
from jotlight.networks.network import Network
from jotlight.networks.planes_network import ColorNetwork, FilmNetwork
from jotlight.parameter_names import check_choice
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.sensor import Sensor

_Kind = TypeVar("_Kind", Network, ColorNetwork, FilmNetwork)

_kept: dict[tuple[Path, int], Any] = {}
"""The networks that were read, by file and number of rotations.

Reading takes longer than the reconstruction of a small image.
"""

DEFAULT_SIZE = "medium"
"""The default size. It has no networks for one K alone."""

TRAINED_TRIALS = tuple(side**2 for side in range(3, 11))
"""Values of K for which there are "two-layer" and "small" networks for this K alone."""

_FOR_ONE = "two-layer", "small"
"""Sizes that also have networks for one K alone.

These are better than the K-conditioned network of their size, but only for α = K, q = 1, S = 1.
"""

MAX_TRIALS = 256
"""Largest K on which the K-conditioned networks were trained."""

FOLDER = Path(__file__).parent / "weights"
"""Folder of the files: `small-k16.safetensors`, for example, with its card `small-k16.md`."""

TEMPLATES = "templates"
"""Name of the network that denoises the templates of alignments: former weights of "small". With
the present ones, objects are found less well (decision 51)."""

MOSAIC_FILE = FOLDER / "color-mosaic.safetensors"
"""The color network for mosaics, which have one filter on each pixel."""

CHANNELS_FILE = FOLDER / "color-channels.safetensors"
"""The color network for images with three counts per pixel."""

MOSAIC_ROTATIONS = 4
"""Number of rotations of the mosaic over which its color network is averaged. Its file states 1,
with which it is trained further. Decision 47 states what the others gain."""

FILM_START = "large"
"""Size of the gray network whose estimates the film network improves."""

COLOR_START = "large"
"""Size of the gray network whose estimates both color networks improve."""

FILM_FILE = FOLDER / "film.safetensors"
"""The recurrent network for the images of films."""

PLANES_FILES = MOSAIC_FILE, CHANNELS_FILE, FILM_FILE
"""The networks that read planes. All others read counts or bits."""

_MAX_DARK_COUNTS = 0.05
"""Largest dark counts per jot and frame that networks for one K serve.

The noise of such dark counts is small compared with that of the light.
"""


def pretrained(sensor: Sensor, quality: str = "medium") -> Network:
    """Return the pretrained network for a sensor.

    The networks are tied: they have one weight for all jots of a pixel. So each serves counts, and
    every combination of jots and frames with the same number K of bits per pixel.

    Parameters
    ----------
    sensor : Sensor
        Any sensor. Dead jots are allowed.
    quality : {"two-layer", "small", "medium", "large", "extra-large"}
        Size of the network. In this order: the paper's two layers; seven layers of up to 12
        channels, or six for a single K; thirteen of up to 52 channels; fifteen of up to 80
        channels; and these fifteen with their output averaged over four rotations of the data. The
        network of each size serves every number of trials per pixel at any exposure. For ηα = K,
        threshold 1, S = 1, the box kernel, dark counts of at most 0.05, and K = 9, 16, 25, 36, 49,
        64, 81, and 100, "two-layer" and "small" are networks for this K alone.

    Returns
    -------
    Network
        The network. Counts that carry no sensor are taken for those of `sensor`.

    Raises
    ------
    TypeError
        When `sensor` is not a :class:`jotlight.Sensor`.
    ValueError
        For an unknown quality.

    Examples
    --------
    >>> import numpy as np
    >>> sensor = jl.Sensor(oversampling=2, frames=4)
    >>> bits = sensor.expose(np.full((8, 8), 0.5), rng=0)
    >>> jl.pretrained(sensor, "two-layer").reconstruct(bits).shape
    (8, 8)
    """
    if not isinstance(sensor, Sensor):
        raise TypeError(
            "sensor: expected a jotlight.Sensor, such as Sensor(frames=16), got "
            f"{sensor!r}; pretrained(sensor, 'large') selects a size"
        )
    check_quality(quality)
    return _load(pretrained_file(sensor, quality), sensor, quality)


def pretrained_file(
    sensor: Sensor, quality: str = "medium", *, is_conditional: bool = False
) -> Path:
    """Return the file of the network of a size that serves a sensor.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    quality : {"two-layer", "small", "medium", "large", "extra-large"}
        The size. "extra-large" has the file of "large".
    is_conditional : bool
        Whether it must be the K-conditioned network of this size.

    Examples
    --------
    >>> pretrained_file(jl.Sensor(frames=16), "small").name
    'small-k16.safetensors'
    """
    if quality == EXTRA_LARGE:
        quality = "large"
    if is_conditional or uses_conditional(sensor, quality):
        return FOLDER / f"{quality}.safetensors"
    return FOLDER / f"{quality}-k{sensor.trials}.safetensors"


def pretrained_conditional(sensor: Sensor, quality: str) -> Network:
    """Return the trained K-conditioned network of a size, also where :func:`pretrained` does not.

    Examples
    --------
    >>> pretrained_conditional(jl.Sensor(frames=16), "small").trials_range
    (1, 256)
    """
    check_quality(quality)
    return _load(pretrained_file(sensor, quality, is_conditional=True), sensor, quality)


def pretrained_color(file: Path) -> ColorNetwork:
    """Return a trained color network: the one in `MOSAIC_FILE` or in `CHANNELS_FILE`.

    That for mosaics is averaged over four rotations.

    Examples
    --------
    >>> pretrained_color(MOSAIC_FILE).trials_range
    (1, 256)
    """
    return _read(ColorNetwork, file, MOSAIC_ROTATIONS if file == MOSAIC_FILE else 1)


def pretrained_film() -> FilmNetwork:
    """Return the trained film network.

    Examples
    --------
    >>> pretrained_film().planes
    14
    """
    return _read(FilmNetwork, FILM_FILE)


def _load(file: Path, sensor: Sensor, quality: str) -> Network:
    network = _read(Network, file, 4 if quality == EXTRA_LARGE else 1)
    network.default_sensor = sensor
    return network


def _read(kind: type[_Kind], file: Path, rotations: int = 1) -> _Kind:
    """Return a copy of the network in a file. The caller may change its attributes."""
    if (file, rotations) not in _kept:
        network = kind.load(file)
        network.rotations = rotations
        _kept[file, rotations] = network
    copied: _Kind = _kept[file, rotations].sharing_engine()
    return copied


def uses_conditional(sensor: Sensor, quality: str) -> bool:
    """Return whether the trained network of a size for a sensor is K-conditioned.

    Examples
    --------
    >>> sensors = jl.Sensor(frames=16), jl.Sensor(frames=20)
    >>> tuple(uses_conditional(sensor, "small") for sensor in sensors)
    (False, True)
    """
    if not sensor.has_plain_bits:
        return True
    efficiency, dark_counts = reference_jot(sensor)
    detections = efficiency * sensor.gain / sensor.trials
    is_usual = (
        sensor.kernel == "box"
        and sensor.threshold == 1
        and abs(detections - 1) <= 1e-9
        and sensor.max_intensity == 1
        and dark_counts <= _MAX_DARK_COUNTS
    )
    return not (is_usual and quality in _FOR_ONE and sensor.trials in TRAINED_TRIALS)


def check_quality(quality: str) -> None:
    """Raise ValueError for an unknown size."""
    check_choice("quality", quality, QUALITIES)
