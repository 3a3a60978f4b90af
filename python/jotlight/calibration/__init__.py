"""Calibration: what a dark and a flat capture tell of a sensor's jots."""

from jotlight.calibration.bulk import Bulk, fit_bulk
from jotlight.calibration.estimate import calibrate
from jotlight.calibration.result import Calibration
from jotlight.calibration.steadiness import Steadiness, steadiness

__all__ = ["Bulk", "Calibration", "Steadiness", "calibrate", "fit_bulk", "steadiness"]
