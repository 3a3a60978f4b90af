"""Images that hold the means of frames, times a scale, as stacks of counts."""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import positive_number, whole_number
from jotlight.errors import counted, warn
from jotlight.formats.capture import Capture, CountStack
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames, read_frames
from jotlight.sensing.data.scaled_counts import (
    check_trials,
    find_fewer_trials,
    recognize_trials,
    unscale_counts,
)


def unscale(capture: Capture, scale: float, trials: int | None) -> CountStack:
    """Return the counts of images that hold the means of frames, times a scale.

    Parameters
    ----------
    capture : Bits or CountStack
        Capture, which must be a stack. Its images are converted when they are read.
    scale : float
        The value of a pixel that is 1 in all frames, such as 255.
    trials : int
        Number of binary readings behind each value of one image.

    Raises
    ------
    ValueError
        When the capture has no scaled counts, a number is missing or out of range, or values of
        the first image are not multiples of scale / trials. Reading the other images raises it for
        their values.

    Examples
    --------
    >>> from jotlight.sensing.parameters.provenance import Provenance
    >>> stack = CountStack(np.array([[[0, 51, 255]]]), Provenance("png", "mean.png"))
    >>> unscale(stack, 255, 5).sum().tolist()
    [[0, 1, 5]]
    """
    if isinstance(capture, Bits):
        raise ValueError(
            "counts_scale: is for images that hold means of frames, but the file holds bits; leave "
            "it out (--counts-scale)"
        )
    name = capture.provenance.name
    if capture.trials is not None:
        raise ValueError(
            f"counts_scale: {name} states counts of {counted(capture.trials, 'trial')}, which have "
            "no scale; leave it out (--counts-scale)"
        )
    scale = positive_number("counts_scale", scale)
    if trials is None:
        raise ValueError(f"trials: {_missing_trials(capture, scale)}")
    trials = whole_number("trials", trials, 1)
    check_trials(capture.images.dtype, scale, trials)
    images = capture.images

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        try:
            return unscale_counts(read_frames(images, start, stop), scale, trials)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error

    fewer = find_fewer_trials(read(0, 1), trials)
    if fewer is not None:
        warn(
            f"{name}: is read as means of {counted(trials, 'frame')}, but means of {fewer} explain "
            f"all values of the first image; if {fewer} is right, pass trials={fewer} (--trials "
            f"{fewer})"
        )
    verify = images.verify if isinstance(images, Frames) else lambda: None
    counts = Frames(images.shape, read, np.int32, verify)
    note = f"means of {counted(trials, 'frame')}, times {scale:g}"
    return dataclasses.replace(
        capture, images=counts, provenance=capture.provenance.with_notes(note), trials=trials
    )


def _missing_trials(stack: CountStack, scale: float) -> str:
    text = (
        f"{stack.provenance.name}: expected, beside the scale, the number of frames of which each "
        "value is the mean; pass trials= (--trials)"
    )
    trials = recognize_trials(read_frames(stack.images, 0, 1), scale)
    return text if trials is None else f"{text}; {trials} explains all values of the first image"
