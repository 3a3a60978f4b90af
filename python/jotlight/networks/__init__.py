"""Reconstruction networks: linear filters, each followed by cubic B-splines (paper, section 3).

In reading order: `layer` (one layer), `graph` (how layers are connected), `bounds` (why no value
overflows), `splines` and `conditioning` (the B-spline basis, and parameters that depend on K),
`architectures` (networks at their initial parameters), `network` (the class that users meet),
`layer_checks` (that its layers fit), `served_sensors` (whose data it serves), `inference` (how it
computes an estimate), `conditional_inference` and `trials_map` (the same for any numbers of
trials), `finer_grid` (the same on a grid of half pixels), `network_files` (its file format),
`onnx_export` (a network as an ONNX model), and `pretrained` (the trained networks in `weights/`,
each with a model card).

Color: `color_network` (a network that improves classical colors) with `color_layers`,
`color_starts` (the classical colors) with `mosaic_planes`, `color_planes` (what the network reads),
and `color_inference` (how it computes colors).
"""
