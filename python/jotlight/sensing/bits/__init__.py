"""Bits and readings, in memory or in files.

In reading order:

- ``bits``: packed bits. ``frames``: bits that are read from files when they are needed.
- ``readings``: readings of several bits. ``values``: their conversion to arrays.
- ``counting``, ``subsampling``: the ones of bits, and some of them. ``crop``, ``channels``: rows
  and columns, and colors. ``lazy``: lazy arrays. ``preview``: images of bits.
- ``frame_sequence``: what bits and readings have in common. ``output_images``: the array `out` of
  methods.
- ``bits_checks``, ``byte_levels``: checks and messages.
"""
