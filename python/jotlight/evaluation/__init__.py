"""Methods by name, their choice for a sensor, and their quality on images.

In reading order:

- ``held_out`` with ``blend_weights``: the blend of several methods that suits the data, and
  ``mosaic_blend`` the same behind a mosaic. ``many_trials``: where it is recommended.
- ``methods``: every method by name.
- ``color_data``: what the color network takes. ``color_images`` counts it, and estimates three
  channels. ``choice``: the method for some data.
- ``own_method``: functions of the caller as methods.
- ``reconstruct``: an image by the recommended method, or by another one. ``request``: the method
  and its settings. ``run_choice`` runs the chosen method. ``info``: how an image was made.
  ``channels``, ``mosaics``, ``different_readings``: data other than gray plain bits. ``clipping``
  with ``bright_pixels``, and ``dark_counts``, warn about a largest intensity, and dark counts, that
  the data contradict. ``first_frames``: the data that they compare.
  ``weights``: the files of the networks behind a result. ``records``: what it was made of.
- ``uncertainty``: an interval for each pixel. ``intervals``, ``interval_pixels``, and
  ``error_scale`` are for gray images, ``color_intervals`` is for mosaics, and ``channel_intervals``
  for three channels. ``known_errors``: the errors behind an interval. ``unlikely``: where the data
  contradict an estimate. ``known_estimate`` checks an
  estimate of the caller.
- ``evaluate``: one method on many images.
- ``run_methods``, ``compare``: many methods on one image.
"""
