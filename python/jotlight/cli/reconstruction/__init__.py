"""Steps of ``reconstruct`` and ``film``.

In reading order: ``inputs`` (the capture, its sensor, and the method), ``reconstruction`` (one
estimate, its files, and its report), ``film_report`` (the report of a film), and ``records`` (where
results come from).
"""
