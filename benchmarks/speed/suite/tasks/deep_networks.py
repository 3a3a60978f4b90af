"""The deep networks: bits in memory to an estimate in floats."""

import math
from collections.abc import Iterator
from functools import partial

import jotlight as jl
from jotlight.networks.architectures import SIZES
from jotlight.networks.graph import scales
from suite.case import Case, Rival, relative_difference
from suite.tasks.deep_rivals import rivals
from suite.tasks.scene import HEIGHT, PIXELS, SENSOR, WIDTH, bits
from suite.tasks.splines import OPERATIONS
from suite.tasks.two_layer_network import BM3D, noniterative


def cases(size: str, quick: bool) -> Iterator[Case]:
    network = network_of(size)
    multiply_adds, performed, splines = operations_per_pixel(network)
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
            *rivals(network, multiply_adds),
            Rival(BM3D, partial(noniterative, "bm3d"), "bm3d", same=False),
        ],
        difference=relative_difference,
        agreement="largest difference relative to the largest intensity",
        tolerance=1e-4,
        operations=(performed + OPERATIONS * splines + SENSOR.oversampling) * PIXELS,
        direct_operations=(multiply_adds + OPERATIONS * splines + SENSOR.oversampling) * PIXELS,
        bytes=bits().packed.nbytes + 4 * PIXELS,
        operations_note="bits are read and the estimate written once; each pixel takes the "
        "multiplications that the filters need by Winograd's algorithm, the splines, and K̂ rows of "
        "bits",
    )


def network_of(size: str) -> jl.Network:
    """Return the package's network of a size, or an untrained one where there is none."""
    if size in SIZES:
        return jl.pretrained(SENSOR, size)
    return jl.Network.residual(SENSOR, size, rng=0)


def operations_per_pixel(network: jl.Network) -> tuple[float, float, float]:
    """Return the multiply-adds of direct convolution, those of the engine, and the splines."""
    multiply_adds = performed = splines = 0.0
    trials = SENSOR.trials
    layers = network.layers if network.trials_range is None else network.conditioned_layers(trials)
    for layer, scale in zip(layers, scales(layers), strict=True):
        positions = 1 / (scale * layer.upsampling) ** 2
        multiply_adds += math.prod(layer.shape) * positions
        performed += layer.engine_layer.multiplications * positions
        splines += layer.channels / scale**2 if layer.coefficients is not None else 0
    return multiply_adds, performed, splines
