"""The whole learned network: bits in memory to a picture in floats."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import jotlight as jl
from suite.case import CannotRunError, Case, Rival, largest
from suite.paths.filtering import TAPS
from suite.paths.scene import HEIGHT, SENSOR, WIDTH, bits, many_bits, untied
from suite.paths.splines import SLOTS

TORCH, COMPILED = "PyTorch, the same network", "PyTorch, compiled"
BM3D = "non-iterative, BM3D"


def cases(quick: bool) -> Iterator[Case]:
    tied = jl.pretrained(SENSOR, "two-layer")
    methods = [
        Rival("non-iterative, TV", partial(noniterative, "tv"), "skimage", same=False),
        Rival(BM3D, partial(noniterative, "bm3d"), "bm3d", same=False),
    ]
    yield case("network", "Network, tied", tied, methods)
    yield case("network-untied", "Network, untied", untied(tied), [])
    yield case("network-large", "Network, tied, 2,048 × 2,048", tied, None)
    yield case("network-untied-large", "Network, untied, 2,048 × 2,048", untied(tied), None)


def case(name: str, title: str, network: jl.Network, methods: list[Rival] | None) -> Case:
    """With methods for the same purpose as rivals, or, of a large picture, without any rival."""
    seen = many_bits() if methods is None else bits()
    height, width = (size // SENSOR.oversampling for size in seen.shape[1:3])
    rivals = [
        Rival(TORCH, partial(in_torch, network), "torch"),
        Rival(COMPILED, partial(compiled, network), "torch"),
        Rival("PyTorch, without counting", partial(from_sums, network), "torch"),
        *(methods or []),
    ]
    return Case(
        name=name,
        title=title,
        words=f"K = 16, {width} × {height} pixels, from packed bits in memory to a picture in "
        "floats."
        + (" Non-iterative methods count, stabilise, denoise and invert." if methods else ""),
        items=height * width,
        unit="pixels",
        ours=lambda threads: network.reconstruct(seen, threads=threads),
        rivals=[] if methods is None else rivals,
        difference=largest,
        agreement="largest difference relative to the largest intensity",
        tolerance=1e-4,
        slots=(TAPS**2 + 2 * SLOTS + SENSOR.oversampling) * height * width,
        bytes=seen.packed.nbytes + 4 * height * width,
        counted="bits read and picture written once; 225 multiply-adds of the filter, two splines "
        "and K̂ rows of bits a pixel",
    )


def in_torch(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import TorchNetwork

    rival = TorchNetwork(network, HEIGHT, WIDTH)
    return lambda: rival.reconstruct(bits())


def compiled(network: jl.Network, torch: Any) -> Callable[[], np.ndarray]:
    from suite.torch_network import TorchNetwork

    rival = TorchNetwork(network, HEIGHT, WIDTH)
    # It is compiled anew for another number of threads, and both are kept.
    picture = torch.compile(rival.picture, dynamic=False)

    def run() -> np.ndarray:
        with torch.inference_mode():
            return picture(rival.sums(bits()))[0, 0].numpy()

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
            return rival.picture(sums)[0, 0].numpy()

    return run


def noniterative(denoiser: str, _: Any) -> Callable[[], np.ndarray]:
    return lambda: jl.noniterative(bits(), SENSOR, denoiser=denoiser)
