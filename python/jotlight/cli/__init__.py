"""The command line ``jotlight``: a thin layer that parses, calls the library, and reports.

In reading order:

- ``entry``: the entry point. ``app``: all commands, and the translation of errors into exit codes.
- One module per command: ``demo``, ``compare``, ``simulate``, ``reconstruct``, ``film``,
  ``calibrate``, ``train``, ``fine_tune``, ``evaluate``, ``reproduce``, ``plan``, ``info``,
  ``convert``, ``gather``, ``view``.
- Option groups, each declared once as a dataclass: ``common_options``, ``capture_options``,
  ``sensor_options`` with ``sensor_values``, ``method_options``, ``motion_options``,
  ``output_options``, ``run_options``, ``training_options``.
- Steps of ``reconstruct`` and ``film``: ``inputs``, ``captured``, ``applied_calibration``,
  ``reconstruction``, ``film_report``, ``color_choice``, ``advice``, ``jot_checks``, ``records``.
- ``many``, ``capture_jobs``: runs over many captures. ``run_notes``: what they assume.
- Parts of ``info``: ``capture_facts``, ``network_facts``, ``origins``.
- Steps of ``train`` and ``fine-tune``: ``learners``, ``training_data``, ``training_run``.
- Terminal: ``console`` for output, ``signals`` for termination, ``examples`` for help pages.
"""
