"""Parts of merging: sums over jots as pixels, jots of several kinds, and finer grids.

In reading order:

- ``merged_pixels``: sums over jots along a motion as the counts of pixels. ``finer``: a grid of
  half pixels.
- ``jot_kinds``, ``jot_squares``: jots behind color filters, or with different thresholds.
  ``mosaic_colors``, ``threshold_maps``: their merged counts.
"""
