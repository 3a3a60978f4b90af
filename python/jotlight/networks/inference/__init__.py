"""How the engine computes an image from bits or counts.

In reading order:

- ``engine_backed``: the network of the engine behind a network of layers. ``served_sensors``: whose
  data a network serves.
- ``inference``: how the engine gets the data. ``conditional_inference``, ``trials_map``: smooth
  kernels, and maps of trials.
- ``dim_scenes``, ``dark_regions``: which scenes the engine corrects, because hardly any bit is 1.
  ``coarse_scales``: squares of pixels that differ. ``finer_grid``: a grid of half pixels.
"""
