"""The model of the sensor: from an image to bits, and the likelihood of bits.

In reading order; each folder imports only what stands before it:

* ``parameters``: the parameters of a sensor, and the response of a jot;
* ``bits``: packed bits and readings, in memory or in files;
* ``drawing``: the random bits and readings of an image;
* ``sensor``: the sensor, and ``merged``: counts whose pixels have different numbers of trials;
* ``data``: the data that methods take;
* ``likelihood``: the spread of light, the likelihood, and the objective of reconstruction.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, ["bits", "data", "drawing", "likelihood", "merged", "parameters", "sensor"]
)
