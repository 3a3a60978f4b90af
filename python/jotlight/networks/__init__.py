"""Reconstruction networks: linear filters, each followed by cubic B-splines (paper, section 3).

In reading order: `layer` (one layer), `graph` (how layers are connected), `bounds` (why no value
overflows), `splines` and `conditioning` (the B-spline basis, and parameters that depend on K),
`architectures` (networks at their initial parameters), `network` (the class that users meet),
`layer_checks` (that its layers fit), `served_sensors` (whose data it serves), `inference` (how it
computes an estimate), `conditional_inference` and `trials_map` (the same for any numbers of
trials), `network_files` (its file format), and `pretrained` (the trained networks in `weights/`,
each with a model card).
"""
