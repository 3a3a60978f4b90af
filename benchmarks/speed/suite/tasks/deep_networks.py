"""The deep networks: bits in memory to an estimate in floats."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import jotlight as jl
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.networks.architectures import SIZES
from jotlight.networks.graph import scales
from suite.case import CannotRunError, Case, Rival, relative_difference
from suite.tasks.scene import HEIGHT, PIXELS, SENSOR, WIDTH, bits
from suite.tasks.splines import OPERATIONS
from suite.tasks.two_layer_network import BM3D, COMPILED, TORCH, noniterative

JOTLIGHT_SPLINES = "PyTorch, with jotlight's splines"


def cases(size: str, quick: bool) -> Iterator[Case]:
    network = network_of(size)
    multiply_adds, splines = flops_per_pixel(network)
    yield Case(
        name=f"network-{size}",
        title=f"Network, {size}",
        description=f"K = 16, {WIDTH} × {HEIGHT} pixels, from packed bits in memory to an "
        "estimate in "
        f"floats; {len(network.layers)} layers, {multiply_adds:,.0f} multiply-adds and "
        f"{splines:,.0f} splines per pixel.",
        items=PIXELS,
        unit="pixels",
        run=lambda threads: network.reconstruct(bits(), SENSOR, threads=threads),
        rivals=[
            Rival(TORCH, partial(torch_run, network), "torch"),
            Rival(COMPILED, partial(compiled_run, network), "torch"),
            Rival(JOTLIGHT_SPLINES, partial(jotlight_module_run, network), "torch"),
            Rival(BM3D, partial(noniterative, "bm3d"), "bm3d", same=False),
        ],
        difference=relative_difference,
        agreement="largest difference relative to the largest intensity",
        tolerance=1e-4,
        operations=(multiply_adds + OPERATIONS * splines + SENSOR.oversampling) * PIXELS,
        bytes=bits().packed.nbytes + 4 * PIXELS,
        operations_note="bits are read and the estimate written once; each pixel takes the "
        "multiply-adds of "
        "the filters (the engine needs fewer), the splines, and K̂ rows of bits",
    )


def network_of(size: str) -> jl.Network:
    """Return the package's network of a size, or an untrained one where there is none."""
    if size in SIZES:
        return jl.pretrained(SENSOR, size)
    return jl.Network.residual(SENSOR, size, rng=0)


def flops_per_pixel(network: jl.Network) -> tuple[float, float]:
    """Return the multiply-adds and the splines per pixel."""
    multiply_adds = splines = 0.0
    for layer, scale in zip(network.layers, scales(network.layers), strict=True):
        multiply_adds += math.prod(layer.shape) / (scale * layer.upsampling) ** 2
        splines += layer.channels / scale**2 if layer.coefficients is not None else 0
    return multiply_adds, splines


def torch_run(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import DeepNetwork

    return layers_run(network, DeepNetwork(network).run_layers)


def compiled_run(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import DeepNetwork

    layers = torch.compile(DeepNetwork(network).run_layers, dynamic=False)
    run = layers_run(network, layers)
    try:
        run()
    except Exception as error:
        raise CannotRunError(f"it does not compile here ({type(error).__name__})") from error
    return run


def jotlight_module_run(network: jl.Network, _: Any) -> Callable[[], np.ndarray]:
    from jotlight.torch import Network

    return layers_run(network, Network(network).run_layers)


def layers_run(network: jl.Network, layers: Callable[..., Any]) -> Callable[[], np.ndarray]:
    """Return the function from bits to an estimate by the layers of a network in PyTorch.

    Those of a K-conditioned network return probabilities of a 1, which become intensities.
    """
    import torch

    from suite.torch_network import counts_of

    conditional = network.trials_range is not None
    trials = SENSOR.trials if conditional else None

    def run() -> np.ndarray:
        with torch.inference_mode():
            output = layers(counts_of(bits(), SENSOR.oversampling), trials)[0, 0].numpy()
        if not conditional:
            return output
        return intensity_from_probability(output, SENSOR, torch.get_num_threads())

    return run
