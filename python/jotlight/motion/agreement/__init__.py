"""Which bits and pixels agree with a motion.

In reading order:

- ``consistency``, ``stricter_test``: a test of each block of frames.
- ``held_out``: how merged counts predict other frames. ``still_window``: when a window without
  motion is better.
- ``flags``, ``expected_errors``: pixels that are not to be trusted.
"""
