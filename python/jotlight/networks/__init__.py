"""Reconstruction networks: linear filters, each followed by cubic B-splines (paper, section 3).

The engine evaluates networks: it computes the parameters for a K, runs the layers on bits or counts
with any numbers of trials, averages over rotations, and returns intensities.

In reading order: `layer` (one layer), `graph` (how layers are connected), `splines` and
`conditioning` (the B-spline basis, and parameters that depend on K), `architectures` (networks at
their initial parameters), `network` (the class that users meet), `engine_backed` (its counterpart
in the engine), `layer_checks` (that its layers fit), `served_sensors` (whose data it serves),
`inference` (how the engine gets the data), `conditional_inference` and `trials_map` (smooth kernels
and maps of trials), `dim_scenes` (several trials as one), `dark_regions` (their mean),
`coarse_scales` (squares of pixels), `finer_grid` (the same on a grid of half pixels),
`network_files` (its file format), `onnx_export` (a network as an ONNX model), and `pretrained` (the
trained networks in `weights/`, each with a model card).

Color: `color_network` (a network that improves classical colors),
`color_starts` (the classical colors) with `mosaic_planes`, `color_planes` (what the network reads),
and `color_inference` (how it computes colors).

Smaller parts: `precision` (in which networks multiply), `loading` (a network of any kind from a
file), `onnx_graph` (for `onnx_export`), `description` and `figure` (networks as texts and
drawings), and `torch_hints` (errors for attributes that only PyTorch's modules have).

Films: `film_network` (a network that also reads the last image) and `film_planes` (what it reads).
`planes_network` and `planes_layers` are the class and the layers of both.
"""
