"""The data that methods take: counts of pixels, stacks, and what they state about themselves.

In reading order:

- ``pixel_counts``: the counts of the pixels of any data. ``stated_trials``, ``scaled_counts``:
  their trials, and means in place of counts.
- ``data_lists``, ``stacks``: several images. ``gray_outputs``: the array `out` of gray images.
- ``contradictions``, ``alike_frames``, ``periodic_rates``, ``filter_hints``: warnings about data
  that contradict their sensor, and a test for a mosaic that is not stated.
"""
