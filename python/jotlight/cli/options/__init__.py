"""Groups of options, each declared once as a dataclass.

- ``common_options``: options and help panels that several commands share.
- ``capture_options``, ``sensor_options`` with ``sensor_values``: a capture and its sensor.
- ``method_options``, ``motion_options``: a reconstruction.
- ``output_options``, ``run_options``: its files, and runs over many captures.
"""
