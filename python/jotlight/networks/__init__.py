"""Reconstruction networks: linear filters, each followed by cubic B-splines (paper, section 3).

The engine evaluates networks: it computes the parameters for a K, runs the layers on bits or counts
with any numbers of trials, averages over rotations, and returns intensities.

In reading order:

- ``layer``: one layer. ``splines``, ``conditioning``: the B-spline basis, and parameters that
  depend on K. ``graph``: how layers are connected. ``layer_checks``: that they fit each other.
- ``architectures``: networks at their initial parameters.
- ``network``: the class that users meet. ``description``, ``figure``: networks as texts and
  drawings. ``stages``: where the parameters came from. ``torch_hints``: errors for attributes that
  only PyTorch's modules have.
- ``planes_network``: a network that improves classical colors, and one for films, which also reads
  the last image.
- ``precision``: in which networks multiply. ``loading``: all kinds of networks, and one from a
  file. ``pretrained``: the trained networks in ``weights/``, each with a model card.

Its folders, each of which imports only those before it:

- ``inference``: how the engine computes an image.
- ``planes``: what color networks and film networks read.
- ``files``: networks in files.
- ``color``: how a color network computes colors. It imports the modules above, too.
"""
