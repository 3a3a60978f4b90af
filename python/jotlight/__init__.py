"""Pictures from the bits of single-photon cameras.

A quanta image sensor reports one bit per tiny pixel (jot) and frame: did at least q photons
arrive? jotlight simulates such sensors and estimates the picture behind the bits.

>>> import jotlight as jl
>>> import numpy as np
>>> sensor = jl.Sensor(oversampling=4)
>>> bits = sensor.expose(np.full((8, 8), 0.5), rng=0)
>>> jl.mle(bits, sensor).shape
(8, 8)
"""

from jotlight import datasets, denoise, metrics, operators, training, tv, vst
from jotlight._engine import __version__
from jotlight.admm import admm_tv
from jotlight.bits import Bits
from jotlight.calibration import Calibration, calibrate
from jotlight.errors import JotlightWarning, MissingExtraError
from jotlight.evaluation import evaluate
from jotlight.formats import open
from jotlight.layer import Layer
from jotlight.likelihood import Likelihood, Problem
from jotlight.mle import mle
from jotlight.mle_iterative import mle_iterative
from jotlight.models import pretrained
from jotlight.network import Network
from jotlight.noniterative import noniterative
from jotlight.planning import Plan, plan
from jotlight.sensor import Sensor
from jotlight.training import train
from jotlight.uncertainty import Uncertainty, uncertainty

__all__ = [
    "Bits",
    "Calibration",
    "JotlightWarning",
    "Layer",
    "Likelihood",
    "MissingExtraError",
    "Network",
    "Plan",
    "Problem",
    "Sensor",
    "Uncertainty",
    "__version__",
    "admm_tv",
    "calibrate",
    "datasets",
    "denoise",
    "evaluate",
    "metrics",
    "mle",
    "mle_iterative",
    "noniterative",
    "open",
    "operators",
    "plan",
    "pretrained",
    "train",
    "training",
    "tv",
    "uncertainty",
    "vst",
]
