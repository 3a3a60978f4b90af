"""Every method and every pretrained network on adversarial bits, at all exposures and shapes.

`methods` lists the methods, `cases` lists the sensors and bits, and `measure` runs all of them.
"""
