"""Color estimates of mosaics and of images with three counts per pixel.

In reading order:

- ``color_data``: what the color network takes. ``color_images`` counts it, and estimates images
  with three counts per pixel.
- ``mosaics``: images behind a mosaic. ``mosaic_blend``: their blend of several methods.
"""
