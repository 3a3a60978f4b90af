"""How a capture is found and opened.

In reading order:

- ``locations``: paths, URLs, and globs. ``remote``: captures at URLs.
- ``detect``: the format of a file.
- ``opening``: a capture, as the caller wants it to be read.
"""
