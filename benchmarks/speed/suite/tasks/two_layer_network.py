"""The two-layer network: bits in memory to an estimate in floats."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import jotlight as jl
from suite.case import CannotRunError, Case, Rival, relative_difference
from suite.tasks.filtering import TAPS
from suite.tasks.scene import HEIGHT, SENSOR, WIDTH, bits, many_bits, untied
from suite.tasks.splines import OPERATIONS

TORCH, COMPILED = "PyTorch, the same network", "PyTorch, compiled"
TV, BM3D = "non-iterative, TV", "non-iterative, BM3D"


def cases(quick: bool) -> Iterator[Case]:
    tied = jl.pretrained(SENSOR, "two-layer")
    methods = [
        Rival(TV, partial(noniterative, "tv"), "skimage", same=False),
        Rival(BM3D, partial(noniterative, "bm3d"), "bm3d", same=False),
    ]
    yield case("network-two-layer", "Network, two-layer", tied, methods)
    yield case("network-two-layer-untied", "Network, two-layer, untied", untied(tied), [])
    yield case("network-two-layer-2048", "Network, two-layer, 2,048 × 2,048", tied, None)
    yield case(
        "network-two-layer-untied-2048",
        "Network, two-layer, untied, 2,048 × 2,048",
        untied(tied),
        None,
    )


def case(name: str, title: str, network: jl.Network, methods: list[Rival] | None) -> Case:
    """Return a case with these methods as further rivals, or a large one without rivals if None."""
    data = many_bits() if methods is None else bits()
    height, width = (size // SENSOR.oversampling for size in data.shape[1:3])
    rivals = [
        Rival(TORCH, partial(in_torch, network), "torch"),
        Rival(COMPILED, partial(compiled, network), "torch"),
        Rival("PyTorch, without counting", partial(from_sums, network), "torch"),
        *(methods or []),
    ]
    return Case(
        name=name,
        title=title,
        description=f"K = 16, {width} × {height} pixels, from packed bits in memory to an "
        "estimate in "
        "floats."
        + (" Non-iterative methods count, transform, denoise, and invert." if methods else ""),
        items=height * width,
        unit="pixels",
        run=lambda threads: network.reconstruct(data, threads=threads),
        rivals=[] if methods is None else rivals,
        difference=relative_difference,
        agreement="largest difference relative to the largest intensity",
        tolerance=1e-4,
        operations=(TAPS**2 + 2 * OPERATIONS + SENSOR.oversampling) * height * width,
        bytes=data.packed.nbytes + 4 * height * width,
        operations_note="bits are read and the estimate written once; each pixel takes 225 "
        "multiply-adds of "
        "the filter, two splines, and K̂ rows of bits",
    )


def in_torch(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import TorchNetwork

    rival = TorchNetwork(network, HEIGHT, WIDTH)
    return lambda: rival.reconstruct(bits())


def compiled(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import TorchNetwork

    rival = TorchNetwork(network, HEIGHT, WIDTH)
    # PyTorch compiles once for each number of threads and keeps both.
    estimate = torch.compile(rival.estimate, dynamic=False)

    def run() -> np.ndarray:
        with torch.inference_mode():
            return estimate(rival.sums(bits()))[0, 0].numpy()

    try:
        run()
    except Exception as error:
        raise CannotRunError(f"it does not compile here ({type(error).__name__})") from error
    return run


def from_sums(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import TorchNetwork

    rival = TorchNetwork(network, HEIGHT, WIDTH)
    sums = rival.sums(bits())

    def run() -> np.ndarray:
        with torch.inference_mode():
            return rival.estimate(sums)[0, 0].numpy()

    return run


def noniterative(denoiser: str, _: Any) -> Callable[[], np.ndarray]:
    return lambda: jl.noniterative(bits(), SENSOR, denoiser=denoiser)
