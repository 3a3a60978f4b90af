"""Bursts of frames, their division into blocks, and counts along a motion.

In reading order:

- ``burst``: bits, color bits, or stacks of counts as frames. ``sensor_blocks``, ``dark_frames``:
  which jots and frames are counted.
- ``block_edges``, ``frame_times``, ``blocks``: how frames are divided, where they lie between
  blocks, and their counts along a motion. ``sums``: counts with their trials. ``kept_sums``: those
  of blocks whose displacements change.
- ``jots``, ``equivalent``, ``lights``: jots that differ, and how bright the frames behind sums are.
- ``reading_counts``, ``reading_response``: readings of several bits, and brackets, as counts.
- ``detection``: whether a scene moves at all.
"""
