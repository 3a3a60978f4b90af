"""The planes that networks read: other estimates of an image, and what its bits add.

``color_planes`` and ``film_planes`` are those of color networks and of film networks.
``planes_layers`` are the layers of both.
"""
