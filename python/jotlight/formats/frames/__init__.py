"""The frames and counts of a file, its label, and how the caller wants them to be read.

In reading order:

- ``raw_layout``: the layout of raw frames. ``reading_options``: the parameters of `jotlight.open`.
- ``labels``, ``labeled``: the sensor and the provenance of arrays. ``count_stacks``: arrays of
  counts as captures. ``blocks``: frames that are stored in blocks.
- ``packing``: frames of one bit per number. ``orientation``, ``selection``: rotation, and some of
  the frames. ``scaled``, ``with_mosaic``: what the caller states about frames.
- ``checked_reading``: the checksum of frames, computed while they are read.
"""
