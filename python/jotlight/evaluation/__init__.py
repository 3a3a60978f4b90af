"""Methods by name, their choice for a sensor, and their quality on images.

In reading order:

- ``held_out`` with ``blend_weights``: the blend of several methods that suits the data.
  ``many_trials``: where it is recommended.
- ``methods``: every method by name. ``requested_method``: the name that a caller requests.
  ``choice``: the method for some data. ``own_method``: functions of the caller as methods.
- ``reconstruct``: an image by the recommended method, or by another one. ``request``: the method
  and its settings. ``run_choice`` runs the chosen method. ``different_readings``: readings that a
  count of ones does not describe.
- ``uncertainty``: an interval for each pixel.
- ``evaluate``: one method on many images.
- ``run_methods``, ``compare``: many methods on one image.

Its folders. They import only those before them, and some of the modules above:

- ``records``: how an image was made.
- ``contradictions``: warnings about a largest intensity, and dark counts, that the data contradict.
- ``color``: images of mosaics and of three channels.
- ``intervals``: the parts of ``uncertainty``.
"""
