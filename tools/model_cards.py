"""The model cards of the trained networks."""

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

import jotlight as jl
from jotlight.evaluation.evaluate import Evaluation
from jotlight.networks.graph import flops_per_pixel
from jotlight.networks.planes_network import PlanesNetwork
from jotlight.networks.stages import Stage, last_run
from rounding import round_layers

N = TypeVar("N", bound=PlanesNetwork)

BSDS300 = "BSDS300 train, gray"
MIXTURE = "BSDS500, CID22, CLIC 2025, GB82, and synthetic patches"
IMAGES = {
    BSDS300: "the 200 training images of the Berkeley segmentation data set BSDS300, in gray (luma "
    "of ITU-R BT.601). The images are display-encoded, not linear in light. The network file "
    "contains no part of them. The data set states no license; its authors ask for a citation: "
    "D. Martin, C. Fowlkes, D. Tal and J. Malik, ICCV 2001.",
    MIXTURE: "335 photographs of the Berkeley segmentation data set BSDS500 that are not among the "
    "test images of BSDS300 (no license stated; please cite P. Arbelaez, M. Maire, C. Fowlkes and "
    "J. Malik, IEEE TPAMI 33(5), 2011), 186 of CID22 (CC BY-SA 4.0), 24 of CLIC 2025 (Unsplash "
    "License), 15 of GB82 (public domain), and synthetic drawings. The patches are luma or a "
    "color plane, display-encoded or linear in light, at the scale of the photograph or averaged "
    "over areas of up to 3 × 3 pixels. The network file contains no part of the images.",
}
"""Descriptions of the training images, by the entry "data" of the network's last training run."""

TEMPLATE = Path(__file__).with_name("model_card.md")
WIDTH = 112
"""Maximum number of characters per line of a card."""

ALL_TRIALS = 1, 4, 16, 64, 256
FLUXES = 0.05, 0.2, 4.0
PHOTONS = "{} photons per jot and frame at intensity 1"

ONE_K = (
    "K = {bits} trials per pixel, from any number of jots and frames, or their counts; threshold "
    "q = 1; gain α = K, which is one photon per jot and frame on average at intensity 1; box "
    "kernel; intensities in [0, 1]."
)
ANY_K = (
    "every K from {low} to {high}, because the network is K-conditioned; every exposure with 0.02 "
    "to 3 detections per jot and frame on average, including dark counts; every threshold q, "
    "because the network estimates the detection probability P(b = 1); box kernel."
)
TWO_LAYER_LIMITS = (
    "smooth kernels, and scenes unlike photographs. On scenes with much finer detail, the network "
    "smooths too much; on scenes with much coarser detail, too little."
)
ONE_EXPOSURE = (
    "other exposures, and dark counts above 0.05 per jot and frame (the network two-layer for any "
    "K serves them); "
)
DEEP_LIMITS = (
    "smooth kernels, color filters, and scenes unlike photographs. Where the bits hold little "
    "information, the estimate shows what photographs usually look like: fine texture may be "
    "missing or invented."
)


def render(name: str, network: jl.Network, recipe: str, scores: str) -> str:
    """Return the card of a network."""
    if network.trials_range is None:
        purpose = ONE_K.format(bits=network.sensor.trials)
    else:
        low, high = network.trials_range
        purpose = ANY_K.format(low=low, high=high)
    return fill(
        TEMPLATE,
        network.layers,
        name=name,
        purpose=purpose,
        images=IMAGES[last_run(network.history)["data"]],
        recipe=recipe,
        scores=scores,
        limits=_limits(network),
    )


def fill(template: Path, layers: Sequence[jl.Layer], **texts: object) -> str:
    """Return the card of a network with these layers, from a template and its other texts."""
    card = template.read_text(encoding="utf-8").format(
        channels=" → ".join(str(layer.channels) for layer in layers),
        parameters=sum(layer.parameter_count for layer in layers),
        kiloflops=flops_per_pixel(layers) / 1000,
        **texts,
    )
    return "".join(_wrap(line) + "\n" for line in card.splitlines())


def ship(
    network: N,
    stages: list[Stage],
    file: Path,
    template: Path,
    measure: Callable[[N], dict[str, object]],
) -> N:
    """Write a network of planes, rounded to float16, and its card, and return it.

    `measure` returns the texts of the card about the rounded network, which lies in the file.
    """
    history = {"start": network.history["start"], "stages": stages}
    layers = round_layers(network.layers)
    network = type(network)(layers, history, trials_range=network.trials_range)
    network.save(file)
    recipe = f"from the gray network medium, {', then '.join(map(str, stages))}."
    write(file, fill(template, layers, recipe=recipe, **measure(network)))
    return network


def write(network_file: Path, card: str) -> None:
    """Write a card beside the file of its network, and print it."""
    network_file.with_suffix(".md").write_text(card, encoding="utf-8")
    print(card, flush=True)


def _limits(network: jl.Network) -> str:
    """Return what a network is not for."""
    if len(network.layers) > 2:
        return DEEP_LIMITS
    return (ONE_EXPOSURE if network.trials_range is None else "") + TWO_LAYER_LIMITS


def _wrap(line: str) -> str:
    indent = "  " if line.startswith("- ") else ""
    return textwrap.fill(
        line, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def score(
    network: jl.Network, tests: list[np.ndarray], validation: Callable[[], list[np.ndarray]]
) -> str:
    """Return the text about a network's scores on the test images.

    `validation` returns the validation images, which only K-conditioned networks need.
    """
    if network.trials_range is not None:
        by_bits = {bits: _mean_psnr(network, bits, tests[:20]) for bits in ALL_TRIALS}
        images = validation()
        validated = {bits: _mean_psnr(network, bits, images) for bits in ALL_TRIALS}
        by_flux = {flux: _mean_psnr(network, 16, images, flux) for flux in FLUXES}
        return (
            f"{conditional_scores(by_bits)} On {len(images)} validation photographs (central 320 × "
            f"320 pixels of every tenth file of three data sets): {_list_psnr(validated)}; at K = "
            f"16 with other exposures, {_list_psnr(by_flux, PHOTONS)}."
        )
    if len(network.layers) == 2:
        own, likelihood = (
            jl.evaluate(method, tests, network.sensor) for method in (network, jl.mle)
        )
        return two_layer_scores(
            psnr=own.mean("psnr"),
            first=Evaluation(own.scores[:20]).mean("psnr"),
            worst=own.mean_of_worst("psnr", 0.05),
            snr=own.mean("snr"),
            ssim=own.mean("ssim"),
            mle_psnr=likelihood.mean("psnr"),
            mle_ssim=likelihood.mean("ssim"),
        )
    psnr = _psnr(network, network.sensor.trials, tests)
    return residual_scores(float(np.mean(psnr)), float(np.mean(psnr[:20])))


def _mean_psnr(
    network: jl.Network, bits: int, images: list[np.ndarray], flux: float = 1.0
) -> float:
    return float(np.mean(_psnr(network, bits, images, flux)))


def _psnr(
    network: jl.Network, bits: int, tests: list[np.ndarray], flux: float = 1.0
) -> list[float]:
    sensor = jl.Sensor(frames=bits, gain=flux * bits)
    return [
        jl.metrics.psnr(network.reconstruct(sensor.expose(image, rng=number), sensor), image)
        for number, image in enumerate(tests)
    ]


def two_layer_scores(**values: float) -> str:
    return (
        "mean PSNR {psnr:.2f} dB (first 20 images: {first:.2f} dB, worst 5 %: {worst:.2f} dB), SNR "
        "{snr:.2f} dB, SSIM {ssim:.3f}. Maximum likelihood on the same bits: PSNR {mle_psnr:.2f} "
        "dB, SSIM {mle_ssim:.3f}."
    ).format(**values)


def residual_scores(psnr: float, first: float) -> str:
    return f"mean PSNR {psnr:.2f} dB (first 20 images: {first:.2f} dB)."


def conditional_scores(psnr: dict[int, float]) -> str:
    return f"mean PSNR of the first 20 images, for α = K: {_list_psnr(psnr)}."


def _list_psnr(psnr: dict[int, float] | dict[float, float], unit: str = "K = {}") -> str:
    return ", ".join(f"{value:.2f} dB for {unit.format(key)}" for key, value in psnr.items())
