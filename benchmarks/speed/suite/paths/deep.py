"""The deep networks: bits in memory to a picture in floats."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import jotlight as jl
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.networks.architectures import SIZES
from jotlight.networks.graph import scales
from suite.case import CannotRunError, Case, Rival, largest
from suite.paths.reconstruction import BM3D, COMPILED, TORCH, noniterative
from suite.paths.scene import HEIGHT, PIXELS, SENSOR, WIDTH, bits
from suite.paths.splines import SLOTS

OUR_SPLINES = "PyTorch, with jotlight's splines"


def cases(member: str, quick: bool) -> Iterator[Case]:
    network = network_of(member)
    multiply_adds, splines = flops_per_pixel(network)
    yield Case(
        name=f"deep-{member}",
        title=f"Network, {member}",
        words=f"K = 16, {WIDTH} × {HEIGHT} pixels, from packed bits in memory to a picture in "
        f"floats; {len(network.layers)} layers, {multiply_adds:,.0f} multiply-adds and "
        f"{splines:,.0f} splines a pixel.",
        items=PIXELS,
        unit="pixels",
        ours=lambda threads: network.reconstruct(bits(), SENSOR, threads=threads),
        rivals=[
            Rival(TORCH, partial(in_torch, network), "torch"),
            Rival(COMPILED, partial(compiled, network), "torch"),
            Rival(OUR_SPLINES, partial(in_module, network), "torch"),
            Rival(BM3D, partial(noniterative, "bm3d"), "bm3d", same=False),
        ],
        difference=largest,
        agreement="largest difference relative to the largest intensity",
        tolerance=1e-4,
        slots=(multiply_adds + SLOTS * splines + SENSOR.oversampling) * PIXELS,
        bytes=bits().packed.nbytes + 4 * PIXELS,
        counted="bits read and picture written once; the multiply-adds of the filters as they "
        "stand, of which the engine does without some, the splines and K̂ rows of bits a pixel",
    )


def network_of(member: str) -> jl.Network:
    """The one in the package, or of the same size with other parameters."""
    if member in SIZES:
        return jl.pretrained(SENSOR, member)
    return jl.Network.residual(SENSOR, member, rng=0)


def flops_per_pixel(network: jl.Network) -> tuple[float, float]:
    """Multiply-adds and splines for a pixel."""
    multiply_adds = splines = 0.0
    for layer, scale in zip(network.layers, scales(network.layers), strict=True):
        multiply_adds += math.prod(layer.shape) / (scale * layer.upsampling) ** 2
        splines += layer.channels / scale**2 if layer.coefficients is not None else 0
    return multiply_adds, splines


def in_torch(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import DeepNetwork

    return run_of(DeepNetwork(network))


def compiled(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import DeepNetwork

    run = run_of(torch.compile(DeepNetwork(network), dynamic=False))
    try:
        run()
    except Exception as error:
        raise CannotRunError(f"it does not compile here ({type(error).__name__})") from error
    return run


def in_module(network: jl.Network, _: Any) -> Callable[[], np.ndarray]:
    from jotlight.torch import Network

    return run_of(Network(network))


def run_of(module: Any) -> Callable[[], np.ndarray]:
    """From bits to a picture by a module, which gives shares of ones where it is told K."""
    import torch

    from suite.torch_network import counts_of

    told = module.origin.trials_range is not None
    number = SENSOR.bits_per_pixel if told else None

    def run() -> np.ndarray:
        with torch.inference_mode():
            picture = module(counts_of(bits(), SENSOR.oversampling), number)[0, 0].numpy()
        return (
            intensity_from_probability(picture, SENSOR, torch.get_num_threads())
            if told
            else picture
        )

    return run
