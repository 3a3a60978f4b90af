"""The likelihood of bits and readings, and the spread of light.

In reading order:

- ``likelihood``: of counts (equation 3). ``reference``: numbers that represent a sensor.
- ``multibit``: of readings of several bits. ``joint_likelihood``, ``joint_term``,
  ``reading_samples``: of readings that differ.
- ``operators``, ``checked_maps``: the spread of light. ``problem``: the objective of
  reconstruction.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["operators"])
