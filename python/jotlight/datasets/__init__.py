"""Scenes to try things on, and the data sets of the paper's experiments."""

from jotlight.datasets.bsds300 import bsds300
from jotlight.datasets.cifar10 import cifar10
from jotlight.datasets.scenes import PHOTOGRAPHS, photograph, uniform_scene, uniform_scenes

__all__ = ["PHOTOGRAPHS", "bsds300", "cifar10", "photograph", "uniform_scene", "uniform_scenes"]
