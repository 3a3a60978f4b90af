"""The methods of the sweep: each of jotlight's with its options, and each pretrained network."""

import dataclasses
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.estimators.mle_iterative import SOLVERS
from jotlight.estimators.tv import NORMS
from jotlight.estimators.vst import INVERSES
from jotlight.evaluation.methods import METHODS
from jotlight.networks.pretrained import FOLDER, PLANES_FILES

SLOW_STRIDE = 17
"""Stride of BM3D, which takes 0.6 s even for one pixel, because it pads to 16 x 16."""

Run = Callable[[jl.Bits, jl.Sensor], npt.NDArray[np.float32]]


@dataclasses.dataclass(frozen=True)
class SweptMethod:
    """A method with its options."""

    run: Run
    network: str | None = None
    """Name of the pretrained network, without ending; None for other methods."""
    stride: int = 1
    """The method runs on every case whose number is a multiple of this prime number."""

    @property
    def trials(self) -> int | None:
        """Return the only K that the network serves, or None if the method serves any K."""
        if self.network is None or (network := load(self.network)).trials_range is not None:
            return None
        return network.sensor.trials


@cache
def load(name: str) -> jl.Network:
    """Return a pretrained network."""
    return jl.Network.load(FOLDER / f"{name}.safetensors")


def build_methods() -> dict[str, SweptMethod]:
    """Return all methods whose packages are installed, by name."""
    found: dict[str, SweptMethod] = {}
    for name, method in METHODS.items():
        if method.quality is not None or not method.available:
            continue
        for title, options in _options(name):
            stride = SLOW_STRIDE if name == "noniterative-bm3d" else 1
            found[name + title] = SweptMethod(partial(_run_method, name, options), stride=stride)
    for limit in "low", "high":
        found[f"uncertainty ({limit})"] = SweptMethod(partial(_confidence_limit, limit))
    denoised = partial(jl.noniterative, denoiser=_absurd_denoiser, threads=1)
    found["noniterative (absurd denoiser)"] = SweptMethod(denoised)
    found["colors"] = SweptMethod(_run_color)
    for path in sorted(set(FOLDER.glob("*.safetensors")) - set(PLANES_FILES)):
        found[f"network {path.stem}"] = SweptMethod(partial(_run_network, path.stem), path.stem)
    return found


def _options(name: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the values of the options of a method that choose an algorithm, with their titles."""
    if name == "mle-iterative":
        return [(f" ({solver})", {"solver": solver}) for solver in SOLVERS]
    if name == "admm-tv":
        return [(f" ({norm})", {"norm": norm}) for norm in NORMS]
    if name == "network-initial":
        return [(" (tied)", {"tied": True}), (" (one weight per jot)", {"tied": False})]
    if name.startswith("noniterative"):
        return [(f" ({inverse})", {"inverse": inverse}) for inverse in INVERSES]
    return [("", {})]


def _confidence_limit(limit: str, bits: jl.Bits, sensor: jl.Sensor) -> Any:
    return getattr(jl.uncertainty(bits, sensor, threads=1), limit)


def _absurd_denoiser(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the largest float32 with alternating signs."""
    largest = np.finfo(np.float32).max
    return np.where(np.indices(image.shape).sum(0) % 2 == 0, largest, -largest)


def _run_method(name: str, options: dict[str, Any], bits: jl.Bits, sensor: jl.Sensor) -> Any:
    return METHODS[name].run(bits, sensor, threads=1, **options)


def _run_network(name: str, bits: jl.Bits, sensor: jl.Sensor) -> Any:
    return load(name).reconstruct(bits, sensor, threads=1)


def _run_color(bits: jl.Bits, sensor: jl.Sensor) -> Any:
    """Return the green of bits behind an RGGB mosaic, of each channel of color bits."""
    # Masks may leave no pixel of a filter, which is an error.
    sensor = sensor.without_maps().replace(kernel="box")
    if min(bits.shape[1:3]) < 2 * sensor.oversampling:  # not all filters have a pixel
        return jl.reconstruct(bits, sensor, threads=1)
    own = sensor.replace(mosaic="RGGB", gain=sensor.gain)
    each = [jl.reconstruct(one, own, threads=1)[..., 1] for one in bits.channels()]
    return np.stack(each, axis=-1) if len(bits.shape) == 4 else np.ascontiguousarray(each[0])
