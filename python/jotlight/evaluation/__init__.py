"""Methods by name, their choice for a sensor, and their quality on images.

In reading order:

- ``held_out``: the blend of several methods that suits the data.
- ``methods``: every method by name.
- ``choice``: the method for some data.
- ``own_method``: functions of the caller as methods.
- ``reconstruct``: an image by the recommended method, or by another one.
- ``evaluate``: one method on many images.
- ``compare``, ``comparison``: many methods on one image.
"""
