"""The command line ``jotlight``: a thin layer that parses, calls the library, and reports.

In reading order:

- ``entry``: the entry point. ``app``: all commands, and the translation of errors into exit codes.
- One module per command: ``demo``, ``compare``, ``simulate``, ``reconstruct``, ``film``,
  ``calibrate``, ``train``, ``fine_tune``, ``evaluate``, ``reproduce``, ``plan``, ``info``,
  ``convert``, ``gather``, ``view``.

What commands share lies in folders. Each imports only those before it, and no command:

- ``terminal``: output, signals, and the examples of help pages.
- ``captures``: the data of a capture together with their sensor.
- ``options``: groups of options, each declared once as a dataclass.
- ``reports``: facts and advice as lines of text.
- ``reconstruction``: steps of ``reconstruct`` and ``film``.
- ``runs``: runs over many captures.
- ``training``: steps of ``train`` and ``fine-tune``.
"""
