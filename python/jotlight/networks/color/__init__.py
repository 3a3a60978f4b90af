"""How a color network computes colors.

``color_starts`` are the classical colors that it improves, and ``mosaic_planes`` the gray images of
the pixels of each filter. ``color_inference`` computes the colors, and
``fringes`` lays neighboring ones on lines.
"""
