"""The warning about dark counts that the data contradict."""

import numpy as np

from jotlight.errors import warn
from jotlight.evaluation.contradictions.first_frames import first_frames, on_usual_grid
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.parameters.response import detection_probability
from jotlight.sensing.sensor import Sensor

_MIN_SHARE = 0.8
"""Smallest number of ones in the data, relative to those that right dark counts cause without
light. The sum over all pixels hardly depends on the noise of a measured map."""

_MIN_EXPECTED = 1000.0
"""Smallest number of ones that the dark counts must cause. By Chernoff's bound, the ones of right
dark counts fall below 80 % of it with a probability of exp(-0.2² · 1000 / 2) = 2e-9 or less."""


def warn_about_dark_counts(images: GrayImages, sensor: Sensor, threads: int | None = None) -> None:
    """Warn if data have fewer ones than the dark counts of their sensor cause without light.

    Readings that differ, mosaics, and pixels whose jots differ are not compared. Of bits, the first
    frames are.
    """
    if not np.any(sensor.dark_counts) or not sensor.has_plain_bits or sensor.mosaic is not None:
        return
    images, sensor = first_frames(on_usual_grid(images), sensor)
    for part in images.parts(sensor):
        pixels = part.count(sensor, threads)
        if pixels.varies_within_pixels:
            return
        of_jots = np.asarray(pixels.dark_counts, np.float64)
        dark = detection_probability(int(sensor.threshold), of_jots)
        caused = np.broadcast_to(pixels.trials * dark, pixels.counts.shape)
        # Each image by itself: another one may be bright.
        ones, expected = (each.sum(axis=(-2, -1)) for each in (pixels.counts, caused))
        share = np.min(ones / np.maximum(expected, 1), where=expected >= _MIN_EXPECTED, initial=1)
        if share < _MIN_SHARE:
            warn(
                "dark_counts: expected detections per jot and frame, but these would cause more "
                f"ones without any light than there are ({share:.0%} of them); divide the counts "
                "of a dark capture by its number of frames, as jotlight.calibrate does"
            )
            return
