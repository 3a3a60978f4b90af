"""Files of NumPy: `.npy`, compressed `.npy.gz`, and `.npz` archives.

In reading order:

- ``captures``: arrays as captures. ``cube``: arrays of packed bits.
- ``arrays``, ``compressed``, ``archives``: the arrays in the three kinds of files.
- ``description``: the `.json` beside a file, which keeps its width, sensor, and provenance.
"""
