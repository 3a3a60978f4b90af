"""How the engine computes an image from bits or counts.

In reading order:

- ``engine_backed``: the network of the engine behind a network of layers. ``served_sensors``: whose
  data a network serves.
- ``inference``: how the engine gets the data. ``conditional_inference``, ``trials_map``: smooth
  kernels, and maps of trials.
- ``dim_scenes``: several trials become one. ``dark_regions``: dark regions get the mean of their
  bits. ``coarse_scales``: squares of pixels. ``finer_grid``: a grid of half pixels.
"""
