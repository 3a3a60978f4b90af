"""Images from the bits of single-photon cameras.

A quanta image sensor consists of tiny pixels, called jots. In each frame, a jot reports one bit: 1
if at least q photons arrive, and 0 otherwise. jotlight simulates such sensors, and estimates images
from their bits.

>>> import jotlight as jl
>>> import numpy as np
>>> sensor = jl.Sensor(oversampling=4)
>>> bits = sensor.expose(np.full((8, 8), 0.5), rng=0)
>>> jl.mle(bits, sensor).shape
(8, 8)
"""

from jotlight import datasets, metrics, training
from jotlight._engine import __version__
from jotlight.calibration import Calibration, calibrate
from jotlight.errors import JotlightWarning, MissingExtraError, PeriodicRatesWarning
from jotlight.estimators import denoise, tv, vst
from jotlight.estimators.admm import admm_tv
from jotlight.estimators.mle import mle
from jotlight.estimators.mle_iterative import mle_iterative
from jotlight.estimators.noniterative import noniterative
from jotlight.estimators.planning import Plan, plan
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.comparison import compare
from jotlight.evaluation.evaluate import evaluate
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.uncertainty import uncertainty
from jotlight.formats import open, save
from jotlight.images.io import read_image
from jotlight.images.saving import save_film, save_image
from jotlight.motion.align import align
from jotlight.motion.merge import merge
from jotlight.motion.motion import Motion
from jotlight.networks.layer import Layer
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained
from jotlight.sensing import operators
from jotlight.sensing.bits import Bits
from jotlight.sensing.likelihood import Likelihood, Problem
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor
from jotlight.training import train

_OTHER_NAMES = {
    "find_hot_jots": "calibration.find_hot_jots",
    "imread": "read_image",
    "imsave": "save_image",
    "imwrite": "save_image",
    "load": "open(path) for a capture, and jotlight.Network.load(path) for a network",
    "film": "save_film(path, images), and `jotlight film` for a capture",
    "psnr": "metrics.psnr",
    "show": "save_image(path, image) to look at an image",
    "ssim": "metrics.ssim",
    "photograph": "datasets.photograph",
}
"""Names in other libraries, and those in jotlight."""


def __getattr__(name: str) -> object:
    """Import `jotlight.torch` and `jotlight.dask` when they are first used: both take time."""
    if name not in ("dask", "torch"):
        hint = f"; write jotlight.{_OTHER_NAMES[name]}" if name in _OTHER_NAMES else ""
        raise AttributeError(f"module 'jotlight' has no attribute {name!r}{hint}")
    import importlib

    return importlib.import_module(f"jotlight.{name}")


__all__ = [
    "Bits",
    "Calibration",
    "JotlightWarning",
    "Layer",
    "Likelihood",
    "Merged",
    "MissingExtraError",
    "Motion",
    "Network",
    "PeriodicRatesWarning",
    "Plan",
    "Problem",
    "Sensor",
    "Uncertainty",
    "__version__",
    "admm_tv",
    "align",
    "calibrate",
    "compare",
    "datasets",
    "denoise",
    "evaluate",
    "merge",
    "metrics",
    "mle",
    "mle_iterative",
    "noniterative",
    "open",
    "operators",
    "plan",
    "pretrained",
    "read_image",
    "reconstruct",
    "save",
    "save_film",
    "save_image",
    "train",
    "training",
    "tv",
    "uncertainty",
    "vst",
]
