"""The data of a capture together with their sensor.

- ``captured``: the data and their sensor. ``applied_calibration``: a calibration of the sensor.
- ``color_choice``: which captures the color network estimates. ``jot_checks``: what jots reveal
  without a calibration.
"""
