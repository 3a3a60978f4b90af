"""Which file is opened, and how.

In reading order:

- ``locations``: paths, URLs, and globs. ``remote``: captures at URLs.
- ``detect``: the format of a file. ``reading_options``: how the caller wants it to be read.
- ``opening``: a capture, as these options state.
"""
