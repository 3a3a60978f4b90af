"""Selection of some frames of a capture, and their rotation and mirroring."""

import functools
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.formats.capture import Capture, CountStack
from jotlight.formats.frames.orientation import orient_image, orient_packed, parse_orientation
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.sensing.bits.frames import Frames, read_frames
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.sensor_like import SensorLike
from jotlight.sensing.parameters.slices import refuse_no_frames

AnySensor = TypeVar("AnySensor", bound=SensorLike)


def select(capture: Capture, options: ReadingOptions) -> Capture:
    """Return the frames of a capture that the options state, rotated and then mirrored.

    The provenance of the result names the array of the file, if its key is stated.

    Raises
    ------
    ValueError
        When the options select no frame.
    """
    frames, flip = options.frames, options.flip
    quarters = parse_orientation(options.rotate, flip)
    notes = [f"the array {options.key}"] if options.key is not None else []
    if quarters:
        notes.append(f"rotated by {90 * quarters} degrees counterclockwise")
    if flip is not None:
        notes.append(f"mirrored, {flip}")

    def annotate(provenance: Provenance) -> Provenance:
        return provenance.with_notes(*notes).reoriented(quarters, flip)

    if isinstance(capture, CountStack):
        images, provenance = capture.images, annotate(capture.provenance)
        stated = capture.sensor
        if stated is not None:
            stated = stated if frames is None else stated.select_frames(frames)
            stated = _orient_sensor(stated, images.shape[1:3], quarters, flip)
        if frames is not None:
            refuse_no_frames("frames", frames, len(images))
            images = images[frames]
            provenance = provenance.with_notes(
                f"{len(images)} images of a stack of {len(capture.images)}"
            )
        oriented = _orient_images(images, quarters, flip)
        return CountStack(oriented, provenance, capture.trials, stated)
    if frames is not None:
        capture = capture[frames]
    if not notes:
        return capture
    packed, width = orient_packed(capture.packed, capture.width, quarters, flip)
    sensor = capture.sensor and _orient_sensor(capture.sensor, capture.shape[1:3], quarters, flip)
    origin = capture.provenance and annotate(capture.provenance)
    return capture.replace(packed=packed, width=width, sensor=sensor, provenance=origin)


def _orient_images(
    images: npt.NDArray[Any] | Frames, quarters: int, flip: str | None
) -> npt.NDArray[Any] | Frames:
    if quarters == 0 and flip is None:
        return images
    frames, height, width, *channels = images.shape
    shape = (frames, *((width, height) if quarters % 2 else (height, width)), *channels)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        part = read_frames(images, start, stop)
        return np.stack([orient_image(image, quarters, flip) for image in part])

    return Frames(shape, read, images.dtype)


def _orient_sensor(
    sensor: AnySensor, size: tuple[int, ...], quarters: int, flip: str | None
) -> AnySensor:
    """Return the sensor of a rotated and mirrored capture, whose size was in jots."""
    maps = {name: orient_image(map_, quarters, flip) for name, map_ in sensor.maps().items()}
    if sensor.mosaic is not None:
        height, width = (length // sensor.oversampling for length in size)
        orient = functools.partial(orient_image, quarters=quarters, flip=flip)
        maps["mosaic"] = sensor.mosaic.oriented(orient, height, width)
    return sensor.replace(**maps)
