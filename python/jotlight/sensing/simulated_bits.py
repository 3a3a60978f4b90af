"""Bits of simulated captures."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames
from jotlight.sensing.sensor_like import SensorLike


def simulated_bits(
    packed: Sequence[npt.NDArray[np.uint8] | Frames], width: int, sensor: SensorLike
) -> list[Bits]:
    """Return simulated bits, which are not tested for periodic rates.

    Their sensor is gray, even if the scene has a period.
    """
    bits = [Bits(each, width, sensor) for each in packed]
    for each in bits:
        each.tested_for_periods = True
    return bits
