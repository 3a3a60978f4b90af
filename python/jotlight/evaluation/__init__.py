"""Methods by name, their choice for a sensor, and their quality on images.

In reading order:

- ``held_out``: the blend of several methods that suits the data.
- ``methods``: every method by name, and the function that chooses one.
- ``evaluate``: one method on many images.
- ``compare``: many methods on one image.
"""
