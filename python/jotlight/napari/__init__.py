"""The plugin for napari: readers, a dock widget, and samples. Requires the extra ``napari``.

- ``reader``: every format that jotlight opens; ``lazy`` computes images when they are viewed.
- ``widget`` with ``work``: the dock widget, and what it does. ``open_widget``: the one for captures
  whose format the user names. ``background``: their base, which works in a thread.
- ``opening``: `bits.show(viewer=True)`. ``samples``: simulated captures.
"""
