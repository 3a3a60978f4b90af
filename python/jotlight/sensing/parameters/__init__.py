"""Parameters of a sensor, and the response of a jot.

In reading order:

- ``sensor_like``: what bits need of a sensor. ``response``: the probability of a one (equation 1).
  ``binomial``: fractions of ones, and the limits of their probabilities.
- ``maps``: parameters that differ from jot to jot. ``parameters``: all of them as a whole.
  ``description``: sensors as texts. ``intensity_scale``: the light at intensity 1.
- ``sensor_checks``: checks of all parameters.
- ``reading_checks``, ``reading_groups``: several bits and read noise, and groups of frames with one
  gain and one threshold.
- ``mosaic``, ``mosaic_text``, ``mosaic_checks``: color filters.
- ``provenance``: where bits come from. ``slices``: parts of frames.
"""
