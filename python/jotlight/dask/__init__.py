"""Captures larger than one machine: lazy arrays of dask.

Requires the extra `dask`. The scheduler is the active one of dask: threads by default, or the
cluster of a ``dask.distributed.Client``. :func:`count`, :func:`reconstruct`, and :func:`calibrate`
return lazy arrays. Their values do not depend on the chunks, the scheduler, or the workers.

>>> import jotlight as jl
>>> bits = jl.Sensor(frames=256).expose(jl.datasets.photograph("camera")[::4, ::4], rng=0)
>>> film = jl.dask.reconstruct(bits, window=64, method="mle")
>>> film.shape, film.compute().dtype
((4, 128, 128), dtype('float32'))

``counting``, ``reconstruction``, and ``calibration`` hold the three functions, and ``pieces`` the
division of windows among workers.
"""

from jotlight.dask.calibration import LazyCalibration, calibrate
from jotlight.dask.counting import count
from jotlight.dask.reconstruction import reconstruct

__all__ = ["LazyCalibration", "calibrate", "count", "reconstruct"]


def __dir__() -> list[str]:
    return __all__
