"""Random bits and readings of an image.

In reading order: ``simulate`` (the light on each jot), ``draws`` (random numbers), ``draw_bits``,
``draw_readings``, and ``exposure`` (the methods of a sensor that expose it).
"""
