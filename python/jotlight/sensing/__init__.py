"""The model of the sensor: from an image to bits, and the likelihood of bits.

In reading order:

* ``sensor`` with ``exposure``, ``simulate``, ``draws``, and ``draw_bits``: the parameters of a
  sensor, and the random bits of an image. ``sensor_checks`` checks the parameters, ``maps`` and
  ``values`` check those that differ from jot to jot, ``parameters`` treats all of them as a whole,
  and ``intensity_scale`` serves simulations;
* ``readings``, ``multibit``, and ``draw_readings``: several bits, and read noise;
  ``reading_checks`` checks their parameters, and ``reading_groups`` divides frames into groups
  with one gain and one threshold;
* ``mosaic`` with ``mosaic_text`` and ``mosaic_checks``: color filters;
* ``bits``, ``frames``, and ``provenance``: packed bits in memory or in files, and their origin.
  ``frame_sequence`` compares bits, and readings.
  ``sensor_like`` is what bits need of a sensor, ``counting`` counts their ones, ``lazy`` makes lazy
  arrays, ``crop`` takes some rows and columns by their ``slices``, and ``preview`` shows them;
* ``merged``: counts whose pixels have different numbers of trials;
* ``channels`` and ``pixel_counts``: the channels of color data, and the counts of their pixels,
  whose trials may be stated (``stated_trials``). ``data_lists`` and ``stacks`` serve several
  images, ``output_images`` and ``gray_outputs`` the array `out` of methods. ``subsampling`` draws
  some of the bits of each pixel;
* checks and messages: ``bits_checks``, ``byte_levels`` (which recognizes unpacked bits),
  ``alike_frames``, ``scaled_counts`` (which recognizes means), ``array_hints``, and
  ``description`` (sensors as texts);
* ``periodic_rates`` with ``filter_hints``: a test for a mosaic that is not stated.
  ``contradictions``: sensors that contradict the one that the data carry;
* ``response`` and ``reference``: the response of a jot, and numbers that represent a sensor;
* ``binomial``: fractions of ones, and the limits of their probabilities;
* ``operators`` with ``checked_maps``, ``likelihood``, and ``problem``: the spread of light, the
  objective of reconstruction, and its maximization. ``joint_likelihood`` is the objective for
  readings which differ, a sum of one ``joint_term`` for each group, from ``reading_samples``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["operators"])
