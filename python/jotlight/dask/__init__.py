"""Captures larger than one machine: lazy arrays of dask, and runs over many captures.

Requires the extra `dask`. The scheduler is the active one of dask: threads by default, or the
cluster of a ``dask.distributed.Client``. :func:`count`, :func:`reconstruct`, and :func:`calibrate`
return lazy arrays. Their values do not depend on the chunks, the scheduler, or the workers.

>>> import jotlight as jl
>>> bits = jl.Sensor(frames=256).expose(jl.datasets.photograph("camera")[::4, ::4], rng=0)
>>> film = jl.dask.reconstruct(bits, window=64, method="mle")
>>> film.shape, film.compute().dtype
((4, 128, 128), dtype('float32'))

In reading order:

- ``counting``, ``reconstruction``, ``calibration``: the three functions.
- ``spans``, ``pieces``, ``chunk_counting``: the frames of windows, their division among workers,
  and what a worker does with a chunk. ``reporting``: what it tells the client.
  ``streaming``: windows in one process, in constant memory.
- ``estimator``: a method with its sensor, as workers run it.
- ``jobs``, ``names``, ``running``: runs over many captures, their results, and their processes.
  ``capture_source``: a capture, as each of them opens it.
  ``cluster``, ``preload``: workers on this machine, or a scheduler. ``shared_runs``, ``gathering``:
  the captures and the results of a job array.
- ``results``: results with a record beside them, and whether they are complete.
- ``store``, ``image_files``, ``markers``, ``records``: results in zarr arrays, the files of their
  images, which groups of them are complete, and what they were made of.
"""

from jotlight.dask.calibration import LazyCalibration, calibrate
from jotlight.dask.counting import count
from jotlight.dask.reconstruction import reconstruct

__all__ = ["LazyCalibration", "calibrate", "count", "reconstruct"]


def __dir__() -> list[str]:
    return __all__
