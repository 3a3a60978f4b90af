"""Parts of the methods for readings that differ, or of several bits.

In reading order:

- ``joint_mle``: the maximum of the likelihood. ``joint_uncertainty``, ``pixel_kinds``: its errors.
- ``merge_near``, ``neighbors``, ``whole_counts``: equivalent counts near an estimate.
- ``reference_sensors``, ``typical_trials``: the sensor of these counts, and their trials.
- ``generalized_anscombe``: variance stabilization.
"""
