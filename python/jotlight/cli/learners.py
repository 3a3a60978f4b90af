"""The function that trains a network: the engine for two layers, PyTorch for deep networks."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jotlight.training as training
from jotlight.networks.architectures import ARCHITECTURES, SIZES, TWO_LAYER
from jotlight.networks.graph import is_sequential
from jotlight.networks.network import Network
from jotlight.sensing.sensor import Sensor
from jotlight.training import OPTIMIZERS, History

DEVICES = "cpu", "cuda"
DEFAULT_OPTIMIZER = "gauss-newton"

_DEEP_ONLY = "device", "trials_range"
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


def is_deep(network: str | None, start: Network | None) -> bool:
    """Return whether the network to start from, or else the network of this size, is deep."""
    if start is not None:
        if network is not None:
            raise ValueError("start: this network has its own layers; leave out --network")
        return not is_sequential(start.layers)
    if network not in (None, *SIZES):
        raise ValueError(f"network: expected one of {', '.join(SIZES)}, got {network!r}")
    return network not in (None, TWO_LAYER)


def refuse_options_of_others(deep: bool, **options: object) -> None:
    """Raise ValueError for an option that is set and belongs to the other kind of network."""
    kinds = f"the network {TWO_LAYER}", f"the networks {', '.join(ARCHITECTURES)}"
    for name, value in options.items():
        if value is not None and value is not False and (name in _DEEP_ONLY) != deep:
            raise ValueError(
                f"{name.replace('_', '-')}: is for {kinds[not deep]}, not for {kinds[deep]}"
            )


def two_layer_learner(
    name: str | None, learning_rate: float | None, damping: float | None
) -> Learner:
    """Return the learner of the two-layer network with an optimizer."""
    name = name or DEFAULT_OPTIMIZER
    if name not in OPTIMIZERS:
        raise ValueError(f"optimizer: expected one of {', '.join(OPTIMIZERS)}, got {name!r}")
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


def deep_learner(learning_rate: float | None, device: str | None) -> Learner:
    """Return the learner of deep networks.

    Raises
    ------
    MissingExtraError
        When PyTorch is not installed.
    """
    from jotlight.torch import distributed
    from jotlight.torch import training as deep_training

    check_device(device)
    rate = deep_training.LEARNING_RATE if learning_rate is None else learning_rate
    return Learner(
        deep_training.train,
        deep_training.STEPS,
        {"device": device, "learning_rate": rate},
        "--learning-rate",
        distributed.rank() == 0,
    )


def check_device(device: str | None) -> None:
    """Raise ValueError for an unknown device."""
    if device not in (None, *DEVICES):
        raise ValueError(f"device: expected one of {', '.join(DEVICES)}, got {device!r}")


def initial_network(
    sensor: Sensor,
    network: str | None,
    *,
    trials_range: str | None,
    sigma: float | None,
    tied: bool,
    seed: int,
) -> Network:
    """Return the network of a size at its initial parameters."""
    if trials_range is not None:
        parsed = parse_trials_range(trials_range)
        return Network.conditional(network or TWO_LAYER, trials_range=parsed, rng=seed)
    if network not in (None, TWO_LAYER):
        return Network.residual(sensor, network, rng=seed)
    return Network.initial(sensor, sigma=0.7 if sigma is None else sigma, tied=tied)


def parse_trials_range(text: str) -> tuple[int, int]:
    """Return the minimum and maximum number of trials per pixel of MIN:MAX.

    Examples
    --------
    >>> parse_trials_range("1:256")
    (1, 256)
    """
    low, colon, high = text.partition(":")
    if not (colon and low.isdecimal() and high.isdecimal() and 1 <= int(low) < int(high)):
        raise ValueError(
            f"trials-range: expected MIN:MAX in whole numbers from 1, such as 1:256, got {text!r}"
        )
    return int(low), int(high)
