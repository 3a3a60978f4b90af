"""The methods that `fig7` and `gain` run on Berkeley images, and the images' center crops."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from jotlight.array_types import Image
from jotlight.estimators.denoise import bm3d
from jotlight.estimators.noniterative import noniterative
from jotlight.evaluation.methods import METHODS
from jotlight.evaluation.own_method import import_method
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.experiments.method_titles import ALGEBRAIC
from jotlight.networks.network import Network
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.sensor import Sensor

TWO_LAYER_METHOD = "network-two-layer"
"""Name of the two-layer network in `METHODS`."""


def methods_for(sensor: Sensor) -> list[str]:
    """Return every installed method that serves a sensor, except slower ones that equal another.

    Examples
    --------
    >>> "mle-iterative" in methods_for(jl.Sensor(oversampling=4))  # it equals "mle" for this kernel
    False
    """
    return [
        name
        for name, method in METHODS.items()
        if method.available
        and method.is_distinct(sensor)
        and method.unsupported_reason(sensor) is None
    ]


def methods_with(
    network: Network, sensor: Sensor, own: Sequence[str] = ()
) -> dict[str, Callable[..., Image]]:
    """Return the methods for a sensor, with this network as the learned one, and the caller's.

    The two inverses of BM3D share one run of the denoiser.
    """
    runs: dict[str, Callable[..., Image]] = {
        name: METHODS[name].run for name in methods_for(sensor)
    }
    if "noniterative-bm3d" in runs:
        denoised: list[Image] = []

        def denoise(z: Image) -> Image:
            denoised[:] = [bm3d(z)]
            return denoised[0]

        def exact(bits: Bits, sensor: Sensor, **options: Any) -> Image:
            return noniterative(bits, sensor, denoiser=denoise, **options)

        def algebraic(bits: Bits, sensor: Sensor, **options: Any) -> Image:
            return noniterative(
                bits, sensor, denoiser=lambda _: denoised[0], inverse="algebraic", **options
            )

        runs["noniterative-bm3d"] = exact
        runs[ALGEBRAIC] = algebraic
    runs[TWO_LAYER_METHOD] = network.reconstruct  # in the place of the pretrained one, if any
    for name in own:
        runs[name] = partial(reconstruct, method=import_method(name))
    return runs


def crop_center(image: Image, side: int | None) -> Image:
    """Return the square of `side` pixels at the center, or the whole image if `side` is None."""
    if side is None:
        return image
    top, left = ((length - side) // 2 for length in image.shape)
    return np.ascontiguousarray(image[top : top + side, left : left + side])
