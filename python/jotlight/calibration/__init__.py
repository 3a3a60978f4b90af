"""Calibration: what a dark and a flat capture reveal about the jots of a sensor.

- `calibrate`: from captures to a `Calibration`. `captured_sensor`: which bits it takes.
- `bulk`: the distribution of the dark counts of ordinary jots, which identifies the hot ones.
- `flat`: the response of each jot, from the `light` on it; `dead_jots`, `outliers`, and the `prnu`
  of the others.
- `evenness`: tests for the image of a scene, and for a mosaic, in a flat capture.
- `agreement`: the test whether hot jots have their dark counts in another capture, too.
- `steadiness`: tests of the assumption that frames are independent and identically distributed.
- `hot_jots`: hot jots in a capture of a scene, without a dark capture.
- `jotlight.sensing.data.periodic_rates`: rates that repeat every few jots, as under a mosaic.
- `jot_mosaics`: the mosaic of jots, and that of pixels.
- `jot_counts`: the counts of a capture, and their detections per frame.
- `result`: the `Calibration`; `fields` are its data, and `files` checks the contents of its files.
- `stated_sensor`: the sensor of a file, changed by a calibration and by options.
- `figure`: a page of plots.
"""

from jotlight.calibration.bulk import Bulk, fit_bulk
from jotlight.calibration.calibrate import calibrate
from jotlight.calibration.hot_jots import find_hot_jots
from jotlight.calibration.result import Calibration
from jotlight.calibration.steadiness import Steadiness, steadiness
from jotlight.sensing.data.periodic_rates import PeriodicRates, find_periodic_rates

__all__ = [
    "Bulk",
    "Calibration",
    "PeriodicRates",
    "Steadiness",
    "calibrate",
    "find_hot_jots",
    "find_periodic_rates",
    "fit_bulk",
    "steadiness",
]


def __dir__() -> list[str]:
    return __all__
