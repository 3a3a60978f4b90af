"""The deep networks: bits in memory to an estimate in floats."""

import math
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import jotlight as jl
from jotlight.networks.architectures import SIZES
from jotlight.networks.graph import scales
from suite.case import Case, Rival, relative_difference
from suite.tasks import relu_network
from suite.tasks.deep_rivals import rivals
from suite.tasks.scene import HEIGHT, PIXELS, SENSOR, WIDTH, bits, photograph
from suite.tasks.splines import OPERATIONS
from suite.tasks.two_layer_network import BM3D, noniterative

INPUT_TRANSFORM, OUTPUT_TRANSFORM = 12 * 12 / 16, 10 * 10 / 16
"""Multiply-adds of Winograd's transforms per channel and position of the output.

For a tile of 4 × 4 outputs, the engine transforms 6 rows and 6 columns of each input, with 12
multiply-adds each, and 6 columns and 4 rows of each output, with 10 each.
"""

DIRECT, PRODUCTS, TRANSFORMS, PERFORMED, RELU = (
    "direct convolution",
    "the engine's products",
    "its transforms",
    "both",
    "plain ReLU network",
)
"""Who does multiply-adds."""


class Operations(NamedTuple):
    """Numbers of operations per pixel. Tiles that cross the border of the image count in part."""

    direct: float
    """Multiply-adds of direct convolution."""
    products: float
    """Multiply-adds of the engine with filters, which are products of transforms for Winograd."""
    transforms: float
    """Multiply-adds of Winograd's transforms."""
    splines: float
    """Evaluations of splines."""

    @property
    def performed(self) -> float:
        """The multiply-adds that the engine does."""
        return self.products + self.transforms


def cases(size: str, quick: bool) -> Iterator[Case]:
    network = network_of(size)
    direct, products, transforms, splines = each = operations_per_pixel(network)
    others = OPERATIONS * splines + SENSOR.oversampling
    yield Case(
        name=f"network-{size}",
        title=f"Network, {size}",
        description=f"K = 16, {WIDTH} × {HEIGHT} pixels, from packed bits in memory to an "
        "estimate in "
        f"floats; {len(network.layers)} layers; per pixel, {direct:,.0f} multiply-adds with direct "
        f"convolution, {each.performed:,.0f} in the engine, and {splines:,.0f} splines.",
        items=PIXELS,
        unit="pixels",
        run=lambda threads: network.reconstruct(bits(), SENSOR, threads=threads),
        rivals=[
            *rivals(network, direct),
            Rival(BM3D, partial(noniterative, "bm3d"), "bm3d", same=False),
        ],
        difference=relative_difference,
        agreement="largest difference relative to the largest intensity",
        tolerance=1e-4,
        operations=(each.performed + others) * PIXELS,
        direct_operations=(direct + others) * PIXELS,
        multiply_adds={
            DIRECT: direct,
            PRODUCTS: products,
            TRANSFORMS: transforms,
            PERFORMED: each.performed,
            RELU: relu_network.cost(relu_network.hidden_channels(direct)),
        },
        psnr=lambda estimate: jl.metrics.psnr(estimate, photograph()),
        bytes=bits().packed.nbytes + 4 * PIXELS,
        operations_note="bits are read and the estimate written once; each pixel takes the "
        "products of the filters and the transforms by Winograd's algorithm, the splines, and K̂ "
        "rows of bits",
    )


def network_of(size: str) -> jl.Network:
    """Return the package's network of a size, or an untrained one where there is none."""
    if size in SIZES:
        return jl.pretrained(SENSOR, size)
    return jl.Network.residual(SENSOR, size, rng=0)


def operations_per_pixel(network: jl.Network) -> Operations:
    """Return the operations of the filters and the splines of a network."""
    direct = products = transforms = splines = 0.0
    trials = SENSOR.trials
    layers = network.layers if network.trials_range is None else network.conditioned_layers(trials)
    for layer, scale in zip(layers, scales(layers), strict=True):
        positions = 1 / (scale * layer.upsampling) ** 2
        taps = math.prod(layer.shape)
        direct += taps * positions
        products += layer.engine_layer.multiplications * positions
        if layer.engine_layer.multiplications < taps:
            outputs, inputs = layer.shape[:2]
            transforms += (INPUT_TRANSFORM * inputs + OUTPUT_TRANSFORM * outputs) * positions
        splines += layer.channels / scale**2 if layer.coefficients is not None else 0
    return Operations(direct, products, transforms, splines)
