"""Test images, and the data sets of the paper's experiments.

- `scenes`: photographs of scikit-image, and the paper's synthetic scenes.
- `bsds300`, `cifar10`: the data sets; `cifar10_files` reads their file formats.
- `fetch`: downloads, verified by SHA-256.
"""

from jotlight.datasets.bsds300 import bsds300
from jotlight.datasets.cifar10 import cifar10
from jotlight.datasets.scenes import PHOTOGRAPHS, photograph, uniform_scene, uniform_scenes

__all__ = ["PHOTOGRAPHS", "bsds300", "cifar10", "photograph", "uniform_scene", "uniform_scenes"]
