"""The model of the sensor: from an image to bits, and the likelihood of bits.

In reading order:

* ``sensor`` and ``simulate``: the parameters of a sensor, and the random bits of an image;
  ``maps`` checks the parameters that differ from jot to jot;
* ``readings``, ``multibit``, ``photon_readings``, ``draw_readings``: gains and thresholds that
  differ, several bits, and read noise;
* ``mosaic`` with ``mosaic_text`` and ``mosaic_checks``: color filters;
* ``bits``, ``frames``, and ``provenance``: packed bits in memory or in files, and their origin;
* ``merged``: counts whose pixels have different numbers of trials;
* ``channels`` and ``pixel_counts``: the channels of color data, and the counts of their pixels;
  ``subsampling`` draws some of the bits of each pixel, and ``scaled_counts`` recognizes means;
* ``periodic_rates``: a test for a mosaic that is not stated;
* ``response`` and ``reference``: the response of a jot, and numbers that represent a sensor;
* ``operators`` and ``likelihood``: the spread of light, and the objective of reconstruction;
  ``joint_likelihood`` is that of readings which differ.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["operators"])
