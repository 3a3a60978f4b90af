"""Arrays and frames of counts, and of readings of several bits, as captures."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.formats.capture import CountStack
from jotlight.formats.frames.labels import read_counts_label, read_readings_label
from jotlight.layout import is_single_image
from jotlight.sensing.bits.bits_checks import warn_about_axes
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor


def as_count_stack(
    images: npt.NDArray[Any] | Frames,
    provenance: Provenance,
    label: str | None = None,
    *,
    floats: bool = False,
    is_stack: bool = False,
) -> CountStack:
    """Return images of counts as a stack.

    Parameters
    ----------
    images : ndarray or Frames of integers
        (H, W), (T, H, W), (H, W, C), or (T, H, W, C), with C <= 4. An array of three dimensions
        is a color image if the last dimension is at most 4.
    provenance : Provenance
        Provenance of the images.
    label : str, optional
        The label that jotlight wrote into the file, which states the number of trials.
    floats : bool
        Whether the numbers may be floats: means of frames, or bits.
    is_stack : bool
        Whether the first axis is known to be that of the images.

    Raises
    ------
    ValueError
        When the shape or the type does not fit, or the label is invalid.
    """
    shape = images.shape
    if images.dtype.kind == "f" and not floats:
        raise ValueError(
            f"expected counts in whole numbers, got {images.dtype} of shape {shape}; floats are an "
            "image of intensities; means of frames, which need counts_scale= (--counts-scale), "
            "such as 1, and trials= (--trials); or bits of 0 and 1, which need unpacked=True "
            "(--unpacked)"
        )
    if images.dtype.kind not in "iubf" or len(shape) not in (2, 3, 4) or images.size == 0:
        raise ValueError(
            "expected counts as integers of shape (H, W), (T, H, W), (H, W, C) or "
            f"(T, H, W, C), without a dimension of 0, got {images.dtype} of shape {shape}"
        )
    if len(shape) == 4 and shape[3] > 4:
        raise ValueError(
            f"expected at most 4 channels on the last axis, (T, H, W, C), got shape {shape}; write "
            "each channel to a file of its own, (T, H, W)"
        )
    sensor, origin = read_readings_label(label)
    if sensor is not None:
        return stack_of_readings(
            images, provenance.converted_from(origin), Sensor.from_parts(sensor)
        )
    trials, origin = read_counts_label(label)
    provenance = provenance.converted_from(origin)
    if trials is not None:
        provenance = provenance.with_notes(f"counts out of {trials}, as the file states")
    if not is_stack and is_single_image(shape):
        images = np.asarray(images)[None]
    elif not is_stack and trials is None:
        warn_about_axes(provenance.name, shape)
    return CountStack(images, provenance, trials)


def stack_of_readings(
    images: npt.NDArray[Any] | Frames, provenance: Provenance, sensor: Sensor
) -> CountStack:
    """Return readings of several bits as a stack that states their sensor.

    Raises
    ------
    ValueError
        When the images do not fit the sensor.
    """
    is_frame = len(images.shape) == 2 or sensor.frames == 1 != len(images)
    if is_frame and is_single_image(images.shape):
        images = np.asarray(images)[None]
    try:
        Readings(images, sensor)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{provenance.name}: {error}") from error
    note = f"readings of {sensor.bit_depth} bits, as the file states"
    return CountStack(images, provenance.with_notes(note), None, sensor)
