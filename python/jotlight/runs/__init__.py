"""Runs: the processing of many captures, or of the windows of a capture, by one command.

The units of a run do not depend on each other. One process, the parts of a job array, or the
workers of a cluster compute them. Only a cluster needs dask.

In reading order:

- ``jobs``, ``names``, ``running``: what a run makes of each capture, the names of captures and of
  their results, and the processes that compute the units. ``capture_source``: a capture, as each
  of them opens it.
- ``cluster``, ``preload``: workers on this machine, or a scheduler. ``reporting``: what a worker
  tells the client. ``shared_runs``, ``gathering``: the captures and the results of a job array.
- ``estimator``: a method with its sensor, as workers run it. ``spans``, ``chunk_counting``: the
  frames of windows, and what a worker does with a chunk of them. ``streaming``: windows in one
  process, in constant memory.
- ``results``: results with a record beside them, and whether they are complete.
- ``store``, ``image_files``, ``markers``, ``records``: results in zarr arrays, the files of their
  images, which groups of them are complete, and what they were made of.
"""
