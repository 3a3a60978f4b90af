"""The function that trains a network: the engine for two layers, PyTorch for deep networks."""

import dataclasses
import os
import re
from collections.abc import Callable
from typing import Any

import jotlight.training as training
from jotlight.networks.architectures import ARCHITECTURES, SIZES, TWO_LAYER
from jotlight.networks.graph import is_sequential
from jotlight.networks.network import Network
from jotlight.networks.precision import PRECISIONS
from jotlight.parameter_names import check_choice
from jotlight.sensing.sensor import Sensor
from jotlight.training import OPTIMIZERS, History

DEVICES = "cpu", "cuda"
DEFAULT_OPTIMIZER = "gauss-newton"

_DEEP_ONLY = "device", "range", "precision"
"""Options of deep networks. Other options that not all networks share are of two-layer ones."""


@dataclasses.dataclass(frozen=True)
class Learner:
    """A function that trains a network, with the settings that others do not have."""

    train: Callable[..., tuple[Network, History]]
    steps: int
    """Default number of steps."""
    settings: dict[str, Any]
    remedy: str
    """Option to lower when a run diverges."""
    is_first: bool = True
    """Whether this process, among those that train together, reports and writes."""


def is_deep(quality: str | None, start: Network | None) -> bool:
    """Return whether the network to start from, or else the network of this size, is deep."""
    if start is not None:
        if quality is not None:
            raise ValueError("start: this network has its own layers; leave out --quality")
        return not is_sequential(start.layers)
    if quality is not None:
        check_choice("quality", quality, SIZES)
    return quality not in (None, TWO_LAYER)


def refuse_options_of_others(deep: bool, **options: object) -> None:
    """Raise ValueError for an option that is set and belongs to the other kind of network."""
    kinds = f"--quality {TWO_LAYER}", f"--quality {', '.join(ARCHITECTURES)}"
    for name, value in options.items():
        if value is not None and value is not False and (name in _DEEP_ONLY) != deep:
            option = "bits-per-pixel: a range" if name == "range" else f"{name}:"
            raise ValueError(f"{option} is for {kinds[not deep]}, not for {kinds[deep]}")


def two_layer_learner(
    name: str | None, learning_rate: float | None, damping: float | None
) -> Learner:
    """Return the learner of the two-layer network with an optimizer."""
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        # Each process of torchrun would write the same files.
        raise ValueError(
            f"a {TWO_LAYER} network is trained by one process, which uses all cores: start the "
            f"command without torchrun, or pass --quality {' or '.join(ARCHITECTURES)}"
        )
    name = name or DEFAULT_OPTIMIZER
    check_choice("optimizer", name, OPTIMIZERS)
    if name == "gauss-newton" and learning_rate is not None:
        raise ValueError("learning-rate: is for adam and projected-gradient, not for gauss-newton")
    if name != "gauss-newton" and damping is not None:
        raise ValueError(f"damping: is for gauss-newton, not for {name}")
    settings = {"learning_rate": learning_rate, "damping": damping}
    optimizer_class: Any = OPTIMIZERS[name]
    optimizer: training.Optimizer = optimizer_class(
        **{key: value for key, value in settings.items() if value is not None}
    )
    remedy = "--damping" if name == "gauss-newton" else "--learning-rate"
    return Learner(training.train, optimizer.steps, {"optimizer": optimizer}, remedy)


def deep_learner(
    name: str | None, learning_rate: float | None, precision: str | None, device: str | None
) -> Learner:
    """Return the learner of deep networks with an optimizer.

    Raises
    ------
    MissingExtraError
        When PyTorch is not installed.
    """
    from jotlight.torch import distributed, optimizers
    from jotlight.torch import training as deep_training

    check_device(device)
    settings = {
        "optimizer": name,
        "learning_rate": learning_rate,
        "precision": precision,
        "device": device,
    }
    for option, value, choices in (
        ("optimizer", name, tuple(optimizers.OPTIMIZERS)),
        ("precision", precision, PRECISIONS),
    ):
        if value is not None:
            check_choice(option, value, choices)
    return Learner(
        deep_training.train,
        deep_training.STEPS,
        {key: value for key, value in settings.items() if value is not None},
        "--learning-rate",
        distributed.rank() == 0,
    )


def check_device(device: str | None) -> None:
    """Raise ValueError for an unknown device."""
    if device is not None:
        check_choice("device", device, DEVICES)


def initial_network(
    sensor: Sensor,
    quality: str | None,
    *,
    trials_range: tuple[int, int] | None,
    sigma: float | None,
    tied: bool,
    seed: int,
) -> Network:
    """Return the network of a size at its initial parameters."""
    if trials_range is not None:
        return Network.conditional(quality or TWO_LAYER, trials_range=trials_range, rng=seed)
    if quality not in (None, TWO_LAYER):
        return Network.residual(sensor, quality, rng=seed)
    return Network.initial(sensor, sigma=0.7 if sigma is None else sigma, tied=tied)


def parse_bits_per_pixel(text: str | None) -> int | tuple[int, int] | None:
    """Return K, or the smallest and the largest K of MIN:MAX.

    Examples
    --------
    >>> parse_bits_per_pixel("16"), parse_bits_per_pixel("1:256")
    (16, (1, 256))
    """
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,10})(?::(\d{1,10}))?", text.strip(), re.ASCII)
    low, high = (int(match[1]), int(match[2] or 0)) if match else (0, 0)
    if match is None or low < 1 or (match[2] is not None and high <= low):
        raise ValueError(
            "bits-per-pixel: expected a number such as 16, or a range MIN:MAX such as 1:256, got "
            f"{text!r}"
        )
    return low if match[2] is None else (low, high)


def describe_kind(network: Network, quality: str | None) -> str:
    """Return which kind of network it is, and for which data.

    Examples
    --------
    >>> describe_kind(jl.Network.initial(jl.Sensor(frames=16)), "two-layer")
    'a two-layer network for 16 bits per pixel'
    """
    size = quality or (TWO_LAYER if len(network.layers) == 2 else f"{len(network.layers)}-layer")
    smallest = None if network.trials_range is None else network.trials_range[0]
    if smallest is None:
        return f"a {size} network for {network.sensor.trials} bits per pixel"
    if smallest == 1:
        return f"a {size} network for any number of bits per pixel"
    return f"a {size} network for {smallest} bits per pixel or more"
