"""Warnings about a sensor that the data contradict.

``clipping`` with ``bright_pixels`` warns about a largest intensity, and ``dark_counts`` about dark
counts. ``first_frames`` are the data that they compare.
"""
