"""Every method and every shipped network on adversarial bits, at all exposures and shapes.

`methods` lists what runs, `cases` lists on which sensors and bits, and `measure` runs it.
"""
