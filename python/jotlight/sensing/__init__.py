"""The model of the sensor: from an image to bits, and the likelihood of bits.

In reading order:

* ``sensor`` and ``simulate``: the parameters of a sensor, and the random bits of an image;
  ``maps`` checks the parameters that differ from jot to jot;
* ``bits``, ``frames``, and ``provenance``: packed bits in memory or in files, and their origin;
* ``merged``: counts whose pixels have different numbers of trials;
* ``channels`` and ``pixel_counts``: the channels of color data, and the counts of their pixels;
  ``subsampling`` draws some of the bits of each pixel;
* ``response`` and ``reference``: the response of a jot, and numbers that represent a sensor;
* ``operators`` and ``likelihood``: the spread of light, and the objective of reconstruction.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["operators"])
