"""Films: an image of each window of frames, along a motion that is carried from window to window.

In reading order:

- ``film``, ``live_film``: films of stored frames, and of frames as they arrive.
- ``image``: an image of a film. ``settings``, ``frames``: how it is made, and of which frames.
- ``state``, ``schedule``, ``candidates``: what a film carries from image to image, when its motion
  is estimated again, and the images along several motions.
- ``merging``, ``carrying``, ``memory``: the steps of an image. ``kinds``: jots of several kinds.
- ``estimates``: the images by the film network.
"""
