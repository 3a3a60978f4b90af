"""The response of a pixel solved for the intensity, and counts of unequal pixels made comparable."""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.chunks import pixel_chunks, take_pixels
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.sensing.pixel_counts import PixelCounts
from jotlight.sensing.reference import Jot, reference_jot
from jotlight.sensing.sensor import Sensor


def equivalent_counts(
    seen: PixelCounts, reference: Jot, threads: int | None
) -> npt.NDArray[np.float32]:
    """Bring all pixels to K valid bits of jots like `reference`.

    Methods that look at many pixels at once take these, so that dead and hot jots do not
    show as a pattern. The counts become real numbers in [0, K]; pixels without any
    valid jot are filled from their neighbours.
    """
    if seen.uniform and (seen.efficiency, seen.dark_counts) == reference:
        return seen.counts.astype(np.float32)
    out = np.empty(seen.counts.shape, np.float32)
    for part in pixel_chunks(out.size):
        engine.equivalent_counts(
            seen.sensor.pixel_response(),
            take_pixels(seen.counts, part),
            take_pixels(seen.trials, part),
            (take_pixels(seen.efficiency, part), take_pixels(seen.dark_counts, part)),
            seen.sensor.bits_per_pixel,
            reference,
            take_pixels(out, part),
            threads,
        )
    return inpaint_dead_pixels(out, seen.dead_pixels)


def intensity_from_probability(
    probability: npt.NDArray[np.float32], sensor: Sensor, threads: int | None
) -> npt.NDArray[np.float32]:
    """The intensity that makes a pixel's bits fire with a probability: equation (5) with p for L/K.

    The jots are as :func:`reference_jot` gives them.
    """
    out = np.empty(probability.shape, np.float32)
    for part in pixel_chunks(out.size):
        engine.mle_from_probability(
            sensor.pixel_response(),
            take_pixels(probability, part),
            reference_jot(sensor),
            take_pixels(out, part),
            threads,
        )
    return out
