"""Parts of the iterative methods.

In reading order:

- ``problem_building``: the objective (equation 4). ``image_solver``: its solution for each image.
- ``convergence``: when a method stops. ``descent``: the steps of maximum likelihood.
- ``admm_splitting``, ``admm_terms``, ``linear_solver``: the steps of ADMM.
- ``local_information``: how much the bits state about a pixel, for the weight of total variation.
"""
