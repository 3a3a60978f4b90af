"""Whether the network that comes with jotlight fits a capture, and how to learn one that does."""

import shlex
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.cli.capture_options import CaptureOptions

_DIM = 0.7
"""A scene whose brightest parts have less intensity is not what the shipped networks are for."""

_COMES_UP = 0.98
"""Share of its largest intensity from which on a network's picture may be held down by it."""


def comes_up(picture: npt.NDArray[np.float32] | float, most: float) -> bool:
    """Whether a picture comes up to the largest intensity that a network gives."""
    return bool(np.max(picture) > _COMES_UP * most)


def to_learn(
    reading: CaptureOptions,
    calibration: Path | None,
    words: dict[str, list[str]],
    *,
    window: int | None,
    bits: bool,
) -> str:
    """The advice to learn a network for a capture, with the command.

    Parameters
    ----------
    reading, calibration, words
        What is reconstructed, and the options of the sensor as they were given.
    window : int or None
        Frames of each picture of a film.
    bits : bool
        Whether the capture tells its number of frames.
    """
    options = {name: pair for name, pair in words.items() if name != "frames" or not bits}
    if window is not None:
        options["frames"] = ["--frames", str(window)]
    command = ["jotlight", "train", "--sensor", str(reading.path), *reading.words()]
    if calibration is not None:
        command += ["--calibration", str(calibration)]
    for pair in options.values():
        command += pair
    return (
        "learn one for this capture in a minute, and give it with --model model.safetensors: "
        + shlex.join([*command, "-o", "model.safetensors"])
    )


def too_dim(brightest: float, learn: str) -> str | None:
    """Say that a scene is not as bright as those that the shipped networks are trained for."""
    if brightest >= _DIM:
        return None
    return (
        "the network that comes with jotlight is for scenes whose brightest parts have intensity "
        f"1, and here they have {brightest:.2g}; {learn}"
    )


def held_down(most: float, otherwise: str, further: float, learn: str | None) -> str:
    """Say that a network holds the brightest parts of a scene down."""
    return (
        f"the scene comes up to the largest intensity {most:g} that the network gives; --method "
        f"{otherwise} goes on to {further:.3g}, where the bits saturate"
        + ("" if learn is None else f"; or {learn}")
    )
