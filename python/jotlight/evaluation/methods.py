"""Every method by name, for the command line, comparisons and the tests that all must pass."""

import dataclasses
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators.admm import admm_tv
from jotlight.estimators.mle import mle
from jotlight.estimators.mle_iterative import mle_iterative
from jotlight.estimators.noniterative import noniterative
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained, unsupported_message
from jotlight.sensing.bits import Bits
from jotlight.sensing.sensor import Sensor

Run = Callable[..., npt.NDArray[np.float32]]


def initial_network(
    data: Bits | npt.ArrayLike, sensor: Sensor, *, threads: int | None = None, **options: Any
) -> npt.NDArray[np.float32]:
    """Run the network at its initial parameters; `options` are those of `Network.initial`."""
    return Network.initial(sensor, **options).reconstruct(data, sensor, threads=threads)


def learned_network(
    data: Bits | npt.ArrayLike,
    sensor: Sensor,
    *,
    quality: str = "medium",
    threads: int | None = None,
) -> npt.NDArray[np.float32]:
    """Run the trained network that comes with jotlight for this sensor."""
    return pretrained(sensor, quality).reconstruct(data, sensor, threads=threads)


@dataclasses.dataclass(frozen=True)
class Method:
    """A reconstruction method: ``run(data, sensor, *, threads)`` gives a picture."""

    title: str
    run: Run
    needs: str | None = None
    """A package beyond those that jotlight brings."""
    unsupported_reason: Callable[[Sensor], str | None] = lambda _: None
    """Says why the method cannot serve a sensor, or None if it can."""
    is_distinct: Callable[[Sensor], bool] = lambda _: True
    """Whether its picture for a sensor is another than that of a faster method."""
    iterative: bool = False
    """Whether it takes `tol`, `max_iter`, `callback` and `return_history`."""

    @property
    def available(self) -> bool:
        """Whether the package that it needs is installed."""
        return self.needs is None or find_spec(self.needs) is not None


def _learned(title: str, quality: str) -> Method:
    run = partial(learned_network, quality=quality)
    return Method(title, run, unsupported_reason=partial(unsupported_message, quality=quality))


METHODS: dict[str, Method] = {
    "mle": Method("maximum likelihood", mle),
    "mle-iterative": Method(
        "maximum likelihood, iterative",
        mle_iterative,
        is_distinct=lambda sensor: sensor.kernel != "box",
        iterative=True,
    ),
    "noniterative-gaussian": Method(
        "non-iterative, Gaussian", partial(noniterative, denoiser="gaussian")
    ),
    "noniterative-tv": Method(
        "non-iterative, total variation", partial(noniterative, denoiser="tv")
    ),
    "noniterative-nlm": Method(
        "non-iterative, non-local means", partial(noniterative, denoiser="nlm")
    ),
    "noniterative-bm3d": Method(
        "non-iterative, BM3D", partial(noniterative, denoiser="bm3d"), needs="bm3d"
    ),
    "admm-tv": Method("ADMM, total variation", admm_tv, iterative=True),
    "network-initial": Method("network, initial", initial_network),
    "network": _learned("network, learned", "two-layer"),
    "network-small": _learned("network, small", "small"),
    "network-medium": _learned("network, medium", "medium"),
    "network-large": _learned("network, large", "large"),
}
"""The methods that can be compared, in the order in which they are shown."""

DEEPER = "network-small", "network-medium", "network-large"
"""Those that go beyond the paper."""

DEFAULT = "network-medium"
"""The method to take where none is asked for."""
