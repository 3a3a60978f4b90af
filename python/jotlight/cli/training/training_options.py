"""Options of the commands that train a network."""

import dataclasses
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.cli.options.common_options import (
    NETWORK_PANEL,
    TRAINING_PANEL,
    ImageKey,
    Seed,
    Threads,
    White,
)
from jotlight.cli.training.learners import DEFAULT_OPTIMIZER, DEVICES, parse_bits_per_pixel
from jotlight.networks.architectures import SIZES, TWO_LAYER
from jotlight.networks.precision import F32, PRECISIONS
from jotlight.training import OPTIMIZERS

TRAINING_SECONDS = 45.0
"""Default time limit of training for a capture, so that the whole command takes a minute."""

_DEVICES = " or ".join(DEVICES)

_STEPS = ", ".join(f"{optimizer.steps} for {name}" for name, optimizer in OPTIMIZERS.items())


@Parameter(name="*", group=TRAINING_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """A training run, with the defaults of ``jotlight train``."""

    output: Annotated[Path, Parameter(alias="-o", help="The trained network, .safetensors.")]
    start: Annotated[
        Path | None,
        Parameter(help="A network to start from. Default: initial parameters."),
    ] = None
    steps: Annotated[
        int | None,
        Parameter(help=f"Number of steps. Default: {_STEPS}; 20000 for deep networks."),
    ] = None
    learning_rate: Annotated[
        float | None,
        Parameter(
            help="Learning rate of the optimizer. Default: 0.01 for adam, 5e-6 for "
            "projected-gradient; 0.003 for deep networks, also for adam."
        ),
    ] = None
    batch: Annotated[
        int | None,
        Parameter(
            help="Patches per step. Default: as many as hold 2^20 pixels for gauss-newton and 2^17 "
            "for other optimizers, 16 for deep networks."
        ),
    ] = None
    patch: Annotated[
        int | None,
        Parameter(
            help="Side of a patch in pixels. Default: 64, or 48 for deep networks, or that of the "
            "smallest image."
        ),
    ] = None
    device: Annotated[
        str | None,
        Parameter(help=f"Device for deep networks: {_DEVICES}. Default: cuda if there is a GPU."),
    ] = None
    resume: Annotated[bool, Parameter(help="Resume a run that was stopped.")] = False
    restart: Annotated[
        bool, Parameter(help="Discard a run that was stopped, and start a new one.")
    ] = False
    plot: Annotated[
        Path | None,
        Parameter(help="A figure of the run and the network: .png, .pdf, or .svg. Default: none."),
    ] = None
    seed: Seed = 0
    threads: Threads = None


@Parameter(name="*", group=TRAINING_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class FineTuningOptions(TrainingOptions):
    """A training run, with the defaults of ``jotlight fine-tune``."""

    start: Annotated[
        Path | None,
        Parameter(
            help="A network to start from. Default: the pretrained network, of the size --quality."
        ),
    ] = None
    steps: Annotated[int | None, Parameter(help="Number of steps. Default: 500.")] = None
    learning_rate: Annotated[
        float | None, Parameter(help="Learning rate of Adam. Default: 0.0005.")
    ] = None
    batch: Annotated[int | None, Parameter(help="Patches per step. Default: 16.")] = None
    patch: Annotated[
        int | None,
        Parameter(help="Side of a patch in pixels. Default: 48, or that of a smaller image."),
    ] = None
    device: Annotated[
        str | None, Parameter(help=f"Device: {_DEVICES}. Default: cuda if there is a GPU.")
    ] = None


@Parameter(name="*", group=NETWORK_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class NetworkOptions:
    """The network to train, and its optimizer; None where an option is not set."""

    quality: Annotated[
        str | None,
        Parameter(
            help=f"Size of the network: {', '.join(SIZES)}. All sizes but {TWO_LAYER} are deep "
            "networks, which estimate better images, and need PyTorch (the extra torch) and more "
            f"time. Default: {TWO_LAYER}."
        ),
    ] = None
    bits_per_pixel: Annotated[
        str | None,
        Parameter(
            help="K, such as 16, in place of --oversampling and --frames; or MIN:MAX, such as "
            "1:256, for a deep network that serves every sensor with MIN bits per pixel or more, "
            "at any exposure. The sensor options then describe the tests. Default: 16, 4 x 4 jots "
            "in one frame."
        ),
    ] = None
    optimizer: Annotated[
        str | None,
        Parameter(
            help=f"Optimizer of the two-layer network: one of {', '.join(OPTIMIZERS)}. Default: "
            f"{DEFAULT_OPTIMIZER}. Deep networks take muon, their default, or adam."
        ),
    ] = None
    precision: Annotated[
        str | None,
        Parameter(
            help="Precision of the products in the training of deep networks: "
            f"{' or '.join(PRECISIONS)}. Some processors compute bf16 faster. Default: {F32}."
        ),
    ] = None
    damping: Annotated[
        float | None, Parameter(help="Initial damping of gauss-newton. Default: 0.1.")
    ] = None
    sigma: Annotated[
        float | None,
        Parameter(
            help="Standard deviation of the initial filter h2 of the two-layer network, in pixels. "
            "Default: 0.7."
        ),
    ] = None
    untied: Annotated[
        bool,
        Parameter(
            help="Train one weight for each jot of a pixel in the two-layer network, instead of "
            "one for all jots."
        ),
    ] = False

    @property
    def trials_range(self) -> tuple[int, int] | None:
        """The smallest and the largest K of a K-conditioned network, or None for another one."""
        bits = parse_bits_per_pixel(self.bits_per_pixel)
        return bits if isinstance(bits, tuple) else None


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class ImageOptions:
    """Images to train on and to test on."""

    key: ImageKey = None
    white: White = None
    test: Annotated[
        Path | None,
        Parameter(
            help="A folder or an array of test images, to measure the progress. Default: none."
        ),
    ] = None
    test_key: Annotated[
        str | None,
        Parameter(
            help="Name of the array of images in the .npz of --test. Default: its only array."
        ),
    ] = None
