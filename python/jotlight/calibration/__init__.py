"""Calibration: what a dark and a flat capture reveal about the jots of a sensor.

- `estimate`: `calibrate`, from captures to a `Calibration`.
- `bulk`: the distribution of the dark counts of ordinary jots, which identifies the hot ones.
- `flat`: the response of each jot, and the dead ones.
- `steadiness`: tests of the assumption that frames are independent and identically distributed.
- `rates`: from counts to detections per frame.
- `result`: the `Calibration`; `fields` are its data, and `files` checks the contents of its files.
- `figure`: a page of plots.
"""

from jotlight.calibration.bulk import Bulk, fit_bulk
from jotlight.calibration.estimate import calibrate
from jotlight.calibration.result import Calibration
from jotlight.calibration.steadiness import Steadiness, steadiness

__all__ = ["Bulk", "Calibration", "Steadiness", "calibrate", "fit_bulk", "steadiness"]
