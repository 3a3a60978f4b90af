"""What `jotlight train` does for deep networks, which PyTorch learns."""

import dataclasses
from collections.abc import Callable
from typing import Any

from jotlight.networks.architectures import ARCHITECTURES, SIZES, TWO_LAYER
from jotlight.networks.graph import is_sequential
from jotlight.networks.network import Network
from jotlight.training import History

DEVICES = "cpu", "cuda"

_OF_DEEP = "device", "rate", "any_bits"
"""Options that do not serve the two-layer network; others that are not shared serve it alone."""


@dataclasses.dataclass(frozen=True)
class Learner:
    """What learns a network."""

    learn: Callable[..., tuple[Network, History]]
    steps: int
    """How many it takes unless told."""
    settings: dict[str, Any]
    """Its own, beside those that all have."""
    remedy: str
    """The option to lower when a run diverges."""
    first: bool = True
    """Whether this process tells and writes, of several that learn together."""


def is_deep(network: str | None, start: Network | None) -> bool:
    """Whether a network is deep: the one to start from, or the one of this name."""
    if start is not None:
        if network is not None:
            raise ValueError(
                "start: a given network comes with its own layers; leave out --network"
            )
        return not is_sequential(start.layers)
    if network not in (None, *SIZES):
        raise ValueError(f"network: expected one of {', '.join(SIZES)}, got {network!r}")
    return network not in (None, TWO_LAYER)


def refuse_others(deep: bool, **given: object) -> None:
    """Raise ValueError for an option that is for the other kind of networks."""
    kinds = f"the network {TWO_LAYER}", f"the networks {', '.join(ARCHITECTURES)}"
    for name, value in given.items():
        if value is not None and value is not False and (name in _OF_DEEP) != deep:
            raise ValueError(
                f"{name.replace('_', '-')}: is for {kinds[not deep]}, not for {kinds[deep]}"
            )


def learner(device: str | None, rate: float | None) -> Learner:
    """PyTorch, on a device.

    Raises
    ------
    MissingExtraError
        When PyTorch is not installed.
    """
    from jotlight.torch import distributed, training

    check_device(device)
    return Learner(
        training.train,
        training.STEPS,
        {"device": device, "rate": training.RATE if rate is None else rate},
        "--learning-rate",
        distributed.rank() == 0,
    )


def check_device(device: str | None) -> None:
    """Raise ValueError for a device that there is not."""
    if device not in (None, *DEVICES):
        raise ValueError(f"device: expected one of {', '.join(DEVICES)}, got {device!r}")


def bits_of(text: str) -> tuple[int, int]:
    """The least and the most bits per pixel of LEAST:MOST."""
    least, colon, most = text.partition(":")
    if not (colon and least.isdecimal() and most.isdecimal() and 1 <= int(least) < int(most)):
        raise ValueError(
            f"any-bits: expected LEAST:MOST in whole numbers from 1, such as 1:256, got {text!r}"
        )
    return int(least), int(most)
