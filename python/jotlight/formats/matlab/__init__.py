"""MATLAB files of versions 5 to 7.3.

`captures` opens files and folders, `files` reads the frames of one file, and `sizes` checks it
before SciPy reads it.
"""
