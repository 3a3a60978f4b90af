"""Intervals of the intensity around an estimate.

In reading order:

- ``error_scale``: the size of a network's errors. ``contrast``: that behind high thresholds.
  ``known_errors``: what else is known about them. ``measured_networks``: the networks for which
  this is known. ``unlikely``: where the data contradict an estimate.
- ``stabilized``: the scale on which these errors are nearly the same at every exposure.
- ``interval_pixels``, ``intervals``: gray images. ``channel_intervals``: three channels.
  ``color_intervals``: mosaics.
- ``widened_intervals``: where readings tell less than their equivalent counts.
- ``known_estimate``: checks of an estimate of the caller.
"""
