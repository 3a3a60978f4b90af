"""Test images, and the data sets of the paper's experiments.

- `scenes`: photographs of scikit-image, and the paper's synthetic scenes.
- `moving_scenes`: bits of photographs that move, with the exact image, motion, and occlusion.
- `bsds300`, `cifar10`: the data sets; `cifar10_files` reads their file formats.
- `fetch`: downloads, verified by SHA-256.
"""

from jotlight.datasets.bsds300 import bsds300
from jotlight.datasets.cifar10 import cifar10
from jotlight.datasets.moving_scenes import MOTIONS, MovingScene, moving
from jotlight.datasets.scenes import PHOTOGRAPHS, photograph, uniform_scene, uniform_scenes

__all__ = [
    "MOTIONS",
    "PHOTOGRAPHS",
    "MovingScene",
    "bsds300",
    "cifar10",
    "moving",
    "photograph",
    "uniform_scene",
    "uniform_scenes",
]


def __dir__() -> list[str]:
    return __all__
