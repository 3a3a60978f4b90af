"""Outlines: which pixels follow which motion, and what is in front.

In reading order:

- ``objects``: objects that the segments of a scene do not explain. ``added_tiles``: tiles that move
  by themselves.
- ``outlines``, ``segment_outlines``, ``short_outlines``: the regions of several motions.
- ``depth``: which segments are in front. ``likelihood_gain``: how much better a motion explains the
  bits than none.
"""
