"""Images from the bits of single-photon cameras.

A quanta image sensor consists of tiny pixels, called jots. In each frame, a jot reports one bit: 1
if it detects at least q photons, and 0 otherwise. jotlight simulates such sensors, and estimates
images from their bits.

>>> import jotlight as jl
>>> import numpy as np
>>> sensor = jl.Sensor(oversampling=4)
>>> bits = sensor.expose(np.full((8, 8), 0.5), rng=0)
>>> jl.mle(bits, sensor).shape
(8, 8)
"""

import importlib

import lazy_loader

from jotlight._engine import __version__

_OTHER_NAMES = {
    "convert": "save(jotlight.open(path), other_path)",
    "fine_tune": "torch.fine_tune(network, bits)",
    "info": "open(path), whose repr states the size and the sensor, or run `jotlight info`",
    "simulate": "Sensor(frames=16).expose(image)",
    "view": "open(path).show(viewer=True), or run `jotlight view` for a capture",
    "find_hot_jots": "calibration.find_hot_jots",
    "imread": "read_image",
    "imsave": "save_image",
    "imwrite": "save_image",
    "load": "open(path) for a capture, and jotlight.Network.load(path) for a network",
    "psnr": "metrics.psnr",
    "show": "save_image(path, image) to look at an image",
    "ssim": "metrics.ssim",
    "photograph": "datasets.photograph",
}
"""Names in other libraries, and those in jotlight."""

_UNLISTED = {
    "calibration",
    "estimators",
    "evaluation",
    "formats",
    "images",
    "motion",
    "networks",
    "sensing",
}
"""Subpackages that are attributes, but that ``from jotlight import *`` leaves out."""

_OPTIONAL = "dask", "torch"
"""Subpackages that need an extra, so ``EAGER_IMPORT=1`` must not import them."""

# The imports are in __init__.pyi. Each happens when its name is first used (decision 36).
_import, _, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["__version__", *(name for name in _names if name not in _UNLISTED)]


def __getattr__(name: str) -> object:
    if name in _names:
        return _import(name)
    if name in _OPTIONAL:
        return importlib.import_module(f"jotlight.{name}")
    hint = f"; write jotlight.{_OTHER_NAMES[name]}" if name in _OTHER_NAMES else ""
    raise AttributeError(f"module 'jotlight' has no attribute {name!r}{hint}")


def __dir__() -> list[str]:
    return __all__
